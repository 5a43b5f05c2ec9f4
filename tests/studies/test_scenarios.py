"""Scenarios of one's own, in every command that takes one."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from glassgait.diagrams.commands import DrawnCommands, FixedCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import make_simulator
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.station import StationConfig
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_expert
from glassgait.models.robots import quadruped
from glassgait.models.task.gait import load_gait
from glassgait.studies.cli import main
from glassgait.studies.common.rollouts import CommandOverride, RolloutConfig, pusher, roll_out
from glassgait.studies.distillation.collection import collect

EXPERT_ALONE = ["evaluate", "scenarios", "--policy", "expert"]
SMALL = ["--n-robots", "2", "--n-steps", "20", "--n-seeds", "1"]
COMMANDED = FixedCommand(speed=0.3, yaw_rate=0.1, dwell=9)
TROT = load_gait("trot")


@pytest.fixture(scope="module")
def expert():
    return load_expert("trot")


@pytest.fixture
def icy(tmp_path):
    path = tmp_path / "icy.yaml"
    path.write_text("title: sheer ice\nstation: {friction: 0.3}\n")
    return path


def test_a_changed_file_is_refused_on_resume(icy, tmp_path, refused):
    run = tmp_path / "run"
    command = [*EXPERT_ALONE, *SMALL, "--scenario", str(icy), "nominal", "--output", str(run)]
    main(command)
    titles = pd.read_csv(run / "scenarios.csv")["scenario"]
    assert sorted(titles) == ["nominal (SAP 10 ms)", "sheer ice"]
    main([*command, "--resume"])
    icy.write_text("title: sheer ice\nstation: {friction: 0.2}\n")
    assert "made with inputs.scenario" in refused([*command, "--resume"])


@pytest.mark.parametrize(
    ("arguments", "reported"),
    [
        ("evaluate scenarios --scenario ice", "unknown scenario 'ice'; the scenarios are"),
        ("evaluate scenarios --scenario bad.yaml", "bad.yaml: unknown key 'frictoin'; remove"),
        ("evaluate scenarios --scenario watched.yaml", "'watched': command uses sliders"),
        ("evaluate scenarios --scenario fast.yaml", "command: speed is 9.0; give -1 to 1"),
        ("evaluate alternation --scenario nominal sap_2ms", "takes one scenario; give one"),
        ("distill --scenario bad.yaml", "bad.yaml: unknown key"),
    ],
)
def test_bad_scenarios_are_refused_before_anything_is_written(
    arguments, reported, refused, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad.yaml").write_text("frictoin: 0.3\n")
    (tmp_path / "watched.yaml").write_text("command: {sliders: true}\n")
    (tmp_path / "fast.yaml").write_text("command: {speed: 9.0}\n")
    assert reported in refused([*arguments.split(), "--output", "run"])
    assert not (tmp_path / "run").exists()


def test_speeds_of_the_settings_stand_in_place_of_the_scenarios_command(expert):
    scenario = Scenario(command=COMMANDED)
    config = RolloutConfig(n_robots=8, n_steps=2, speed_range=(0.5, 0.6))
    speed = roll_out(TROT, alone(expert), scenario, config).command[..., 0]
    assert np.all((speed >= 0.5) & (speed <= 0.6))
    assert config.commanding(scenario).command == DrawnCommands((0.5, 0.6))


@pytest.mark.parametrize(
    ("given", "gait", "asked", "command"),
    [
        (CommandOverride(), TROT, None, FixedCommand(speed=0.5)),
        (CommandOverride(speed=0.1), TROT, COMMANDED, replace(COMMANDED, speed=0.1)),
        (CommandOverride(dwell=7), TROT, DrawnCommands((0.0, 0.2)), FixedCommand(dwell=7)),
        (CommandOverride(), replace(TROT, max_speed=0.3), None, FixedCommand(speed=0.3)),
    ],
)
def test_a_command_is_laid_over_another(given, gait, asked, command):
    assert given.override(gait, asked) == command


def speeds_after_pushes(scenario, seed, expert):
    simulator = make_simulator(MakeLocomotion(TROT, scenario, policy=expert))
    pushed = pusher(simulator, scenario, seed)
    for _ in range(3):
        pushed()
    diagram = simulator.get_system()
    state = diagram.GetOutputPort("state").Eval(simulator.get_context())
    return state[quadruped.LINEAR_VELOCITY]


def test_a_robot_that_is_watched_is_pushed(expert):
    always = Scenario(push_speed=0.5, push_interval=0.02)
    first = speeds_after_pushes(always, 1, expert)
    assert np.all(first[:2] != 0) and first[2] == 0
    np.testing.assert_array_equal(speeds_after_pushes(always, 1, expert), first)
    assert np.any(speeds_after_pushes(always, 2, expert) != first)
    assert not speeds_after_pushes(Scenario(), 1, expert).any()


def test_samples_are_of_the_scenarios_ground_pushes_and_observations(expert):
    scenarios = [
        Scenario(),
        Scenario(station=StationConfig(friction=0.2)),
        Scenario(push_speed=1.0, push_interval=0.02),
        Scenario(true_body_state=True),
    ]
    options = {"episodes": range(1, 3), "n_steps": 20, "speeds": np.array([0.0, 0.5])}
    plain, *others = (
        collect(TROT, alone(expert), **options, worlds=one, generator=np.random.default_rng(0))
        for one in scenarios
    )
    for other in others:
        assert not np.array_equal(other.observations, plain.observations)
