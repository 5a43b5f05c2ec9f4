"""Meshcat: live display and standalone replay."""

import numpy as np
import pytest

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import make_simulator, record
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.visualization import LiveDisplay, open_meshcat, save_replay
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.ground import Ground
from glassgait.models.task.terrain import PLANE, Terrain

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
    assert "needs\nWebGL" in page
    for leg in ("FL", "RR"):
        assert meshcat.HasPath(f"/drake/visualizer/a1/{leg}_calf")
    assert meshcat.HasPath("/drake/gait/state/1")


@pytest.mark.parametrize("terrain", [PLANE, Terrain(kind="blocks", amplitude=0.05)])
def test_a_robot_far_from_where_it_began_stands_on_ground_that_is_drawn(
    trot, standing, meshcat, terrain
):
    display = LiveDisplay(A1, trot, meshcat, terrain=terrain)
    standing[quadruped.POSITION] += [40.0, -3.0, 0.0]
    shown = {"rm_state": np.eye(2)[0], "foot_contact": np.ones(4)}
    display.show(standing, **shown, ghost=standing)
    assert meshcat.HasPath("/drake/visualizer/ghost")
    plant = display._plant
    place = plant.GetPositions(display._plant_context, display._instances[0])[quadruped.POSITION]
    away = np.zeros(3) if terrain.is_plane else Ground([terrain]).periods(standing)
    np.testing.assert_allclose(place, standing[quadruped.POSITION] - away)
    assert terrain.is_plane or np.abs(place[:2]).max() < 5.0
