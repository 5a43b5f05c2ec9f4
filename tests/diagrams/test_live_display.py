"""A walking robot in Meshcat with its ghost, and the shadows of both."""

import numpy as np
import pytest

from glassgait.diagrams.live_display import LiveDisplay
from glassgait.diagrams.shadows import Shadows
from glassgait.diagrams.visualization import open_meshcat
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.ground import Ground
from glassgait.models.task.terrain import PLANE, Terrain

A1 = load_robot()
BLOCKS = Terrain(kind="blocks", amplitude=0.05)


class Recorded:
    """Keeps what it is called for last, in place of Meshcat, which gives nothing back."""

    def __init__(self):
        self.transforms, self.properties, self.objects = {}, {}, []

    def SetObject(self, path, shape, rgba):  # noqa: N802
        self.objects.append(path)

    def SetTransform(self, path, transform):  # noqa: N802
        self.transforms[path] = np.array(transform)

    def SetProperty(self, path, name, value):  # noqa: N802
        self.properties[path, name] = value


@pytest.mark.parametrize("terrain", [PLANE, BLOCKS])
def test_shadows_lie_on_the_ground_under_feet_and_trunk(standing, terrain):
    meshcat = Recorded()
    shadows = Shadows(meshcat, "shadow", A1, terrain=terrain)
    standing[quadruped.POSITION] += [0.4, 0.2, 0.1]
    shadows.show(standing)
    feet = kinematics.world_feet(A1, standing)
    heights = Ground([terrain]).height(feet)
    for leg, foot, height in zip(quadruped.LEGS, feet, heights, strict=True):
        placed = meshcat.transforms[f"shadow/{leg}"]
        np.testing.assert_allclose(placed[:3, 3], [*foot[:2], height])
        assert np.linalg.norm(placed[:3, 0]) == pytest.approx(2.0 * A1.foot_radius)
    trunk = meshcat.transforms["shadow/trunk"]
    np.testing.assert_allclose(trunk[:2, 3], standing[quadruped.POSITION][:2])


def test_the_shadow_of_a_foot_is_fainter_the_higher_the_foot_is(standing):
    meshcat = Recorded()
    shadows = Shadows(meshcat, "shadow", A1)
    seen = []
    for height in (0.0, 0.04, 0.5):
        state = standing.copy()
        state[quadruped.POSITION] += [0.0, 0.0, height]
        shadows.show(state)
        seen.append(meshcat.properties["shadow/FL", "modulated_opacity"])
    assert seen[0] == pytest.approx(1.0, abs=0.05)
    assert seen[0] > seen[1] > seen[2] == 0.0


@pytest.mark.parametrize("terrain", [PLANE, BLOCKS])
def test_a_robot_far_from_where_it_began_stands_on_ground_that_is_drawn(trot, standing, terrain):
    meshcat = open_meshcat()
    display = LiveDisplay(A1, trot, meshcat, terrain=terrain)
    standing[quadruped.POSITION] += [40.0, -3.0, 0.0]
    shown = {"rm_state": np.eye(2)[0], "foot_contact": np.ones(4), "command": np.zeros(2)}
    display.show(standing, **shown, ghost=standing)
    for path in ("shadow/trunk/0", "ghost_shadow/FL/0", "command/tip", "visualizer/ghost"):
        assert meshcat.HasPath(f"/drake/{path}")
    plant = display._plant
    place = plant.GetPositions(display._own, display._instances[0])[quadruped.POSITION]
    away = np.zeros(3) if terrain.is_plane else Ground([terrain]).periods(standing)
    np.testing.assert_allclose(place, standing[quadruped.POSITION] - away)
    assert terrain.is_plane or np.abs(place[:2]).max() < 5.0
