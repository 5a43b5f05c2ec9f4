"""Meshcat: live display and standalone replay."""

import numpy as np

from diagrams.locomotion import LocomotionConfig, MakeLocomotion, SliderCommand
from diagrams.rollout import make_simulator, record
from diagrams.visualization import open_meshcat, save_replay, start_recording
from systems.meshcat_command import SPEED_SLIDER


def test_replay_is_one_page_with_the_robot_and_the_machines_state(trot, make_policy, tmp_path):
    meshcat = open_meshcat()
    diagram = MakeLocomotion(trot, LocomotionConfig(), expert=make_policy(trot), meshcat=meshcat)
    simulator = make_simulator(diagram)
    start_recording(meshcat)
    record(simulator, 10, stop_on_failure=False)
    path = tmp_path / "replay.html"
    save_replay(meshcat, path)
    page = path.read_text()
    assert "<html" in page.lower()
    assert len(page) > 500_000
    assert "http://localhost" not in page
    for leg in ("FL", "RR"):
        assert meshcat.HasPath(f"/drake/visualizer/a1/{leg}_calf")
    assert meshcat.HasPath("/drake/gait/state/q1")


def test_sliders_command_the_robot(trot, make_policy):
    meshcat = open_meshcat()
    diagram = MakeLocomotion(
        trot, LocomotionConfig(command=SliderCommand()), expert=make_policy(trot), meshcat=meshcat
    )
    simulator = make_simulator(diagram)
    meshcat.SetSliderValue(SPEED_SLIDER, -0.3)
    rollout = record(simulator, 2, stop_on_failure=False)
    np.testing.assert_allclose(rollout["command"][-1], [-0.3, 0.0])
