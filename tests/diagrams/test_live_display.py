"""A walking robot in Meshcat with its ghost."""

import numpy as np
import pytest

from glassgait.diagrams.live_display import LiveDisplay
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.ground import Ground
from glassgait.models.task.terrain import PLANE, Terrain

A1 = load_robot()
BLOCKS = Terrain(kind="blocks", amplitude=0.05)


@pytest.mark.parametrize("terrain", [PLANE, BLOCKS])
def test_a_robot_far_from_where_it_began_stands_on_ground_that_is_drawn(
    trot, standing, meshcat, terrain
):
    display = LiveDisplay(A1, trot, meshcat, terrain=terrain)
    standing[quadruped.POSITION] += [40.0, -3.0, 0.0]
    shown = {"rm_state": np.eye(2)[0], "foot_contact": np.ones(4)}
    display.show(standing, **shown, ghost=standing)
    assert meshcat.HasPath("/drake/visualizer/ghost")
    plant = display._plant
    place = plant.GetPositions(display._own, display._instances[0])[quadruped.POSITION]
    away = np.zeros(3) if terrain.is_plane else Ground([terrain]).periods(standing)
    np.testing.assert_allclose(place, standing[quadruped.POSITION] - away)
    assert terrain.is_plane or np.abs(place[:2]).max() < 5.0
