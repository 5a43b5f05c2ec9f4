"""Meshcat: live display and standalone replay."""

import logging
from dataclasses import replace

import numpy as np

import glassgait.diagrams.pair_replay
from glassgait.diagrams.commands import FixedCommand, SliderCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.pair_replay import ReplayedRobot, middle_of_paths, save_pair_replay
from glassgait.diagrams.replay import save_replay
from glassgait.diagrams.rollout import Rollout, make_simulator, record
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.visualization import open_meshcat
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.systems.meshcat_command import SPEED_SLIDER

A1 = load_robot()


CALM = Scenario(command=FixedCommand(), sensor_noise=0.0, true_body_state=True)


def test_replay_is_one_page_with_the_robot_and_the_machines_state(trot, make_policy, tmp_path):
    meshcat = open_meshcat()
    diagram = MakeLocomotion(trot, CALM, policy=make_policy(trot), meshcat=meshcat)
    rollout = record(make_simulator(diagram), 10, stop_on_failure=False)
    path = tmp_path / "replay.html"
    save_replay(diagram, meshcat, rollout, path)
    page = path.read_text()
    assert "<html" in page.lower()
    assert len(page) > 500_000
    assert "http://localhost" not in page
    for leg in ("FL", "RR"):
        assert meshcat.HasPath(f"/drake/visualizer/a1/{leg}_calf")
    assert meshcat.HasPath("/drake/gait/state/1")


def test_two_robots_are_in_one_page_though_one_stops_early(standing, tmp_path, monkeypatch):
    def walk(n_steps, speed):
        time = 0.02 * np.arange(n_steps)
        state = np.tile(standing, (n_steps, 1))
        state[:, quadruped.POSITION.start] = speed * time
        return Rollout(time, {"state": state})

    opened = []

    def open_one():
        opened.append(open_meshcat())
        return opened[-1]

    monkeypatch.setattr(glassgait.diagrams.pair_replay, "open_meshcat", open_one)
    left = ReplayedRobot("A", "<one> & only", "#0072B2", walk(6, 1.0), A1)
    right = ReplayedRobot("B", "two", "#D55E00", walk(11, 2.0), A1)
    path = tmp_path / "replay.html"
    save_pair_replay(left, right, path)
    page = path.read_text()
    assert "&lt;one&gt; &amp; only" in page and "two</div>" in page
    assert page.count("</body>") == 1
    (meshcat,) = opened
    for name in "AB":
        assert meshcat.HasPath(f"/drake/visualizer/{name}/a1/FL_calf")


def test_the_picture_follows_both_robots_and_then_the_one_that_goes_on():
    left = np.array([[0.0, 0.5], [1.0, 0.5]])
    right = np.array([[0.0, -0.5], [2.0, -0.5], [3.0, -0.4], [4.0, -0.4]])
    both = [[0.0, 0.0], [1.5, 0.0]]
    for pair in ((left, right), (right, left)):
        middle = middle_of_paths(*pair)
        np.testing.assert_allclose(middle, [*both, [2.5, 0.1], [3.5, 0.1]])
    np.testing.assert_allclose(middle_of_paths(left, right[:2]), both)


def test_names_of_states_are_no_paths(trot, make_policy):
    states = ("a", "a/<b></script>")
    edges = [
        replace(edge, source=states[k], target=states[1 - k])
        for k, edge in enumerate(trot.transitions)
    ]
    gait = replace(trot, name="own", states=states, initial="a", transitions=tuple(edges))
    meshcat = open_meshcat()
    MakeLocomotion(gait, CALM, policy=make_policy(gait), meshcat=meshcat)
    assert [meshcat.HasPath(f"/drake/gait/state/{k}") for k in range(3)] == [True, True, False]
    assert not meshcat.HasPath("/drake/gait/state/a")


def test_opening_meshcat_says_nothing_and_leaves_drakes_log_as_it_is(caplog):
    log = logging.getLogger("drake")
    with caplog.at_level(logging.INFO, logger="drake"):
        open_meshcat()
        assert log.level == logging.INFO
    assert not caplog.messages


def test_sliders_command_the_robot(trot, make_policy):
    meshcat = open_meshcat()
    scenario = Scenario(command=SliderCommand(), true_body_state=True)
    diagram = MakeLocomotion(trot, scenario, policy=make_policy(trot), meshcat=meshcat)
    simulator = make_simulator(diagram)
    meshcat.SetSliderValue(SPEED_SLIDER, -0.3)
    rollout = record(simulator, 2, stop_on_failure=False)
    np.testing.assert_allclose(rollout["command"][-1], [-0.3, 0.0])
