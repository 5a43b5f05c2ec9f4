"""The ground: its heights, its distance from spheres, and robots that stand on it."""

import numpy as np
import pytest

from glassgait.models import GRAVITY
from glassgait.models.errors import InputError
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.ground import Ground
from glassgait.models.task.randomization import Randomization
from glassgait.models.task.terrain import OVERLAP, REACH, Terrain, grid_of

A1 = load_robot()
UPRIGHT = {
    "blocks": Terrain("blocks", amplitude=0.06),
    "small blocks": Terrain("blocks", amplitude=0.1, cell=0.1, cells=5, seed=3),
    "steps": Terrain("steps", height=0.08),
    "endless steps": Terrain("steps", height=-0.05, endless=True, flight=3),
    "patches": Terrain(patches=0.4),
}
TILTED = {
    "uneven": Terrain("uneven", amplitude=0.06),
    "steep": Terrain("uneven", amplitude=0.15, wavelength=0.8, seed=2),
}
ROUGH = UPRIGHT | TILTED


def places(terrain, count, generator):
    """Draws points (count, 3) in the middle period of the ground and in its neighbours."""
    grid = grid_of(terrain)
    reach = REACH - 2 * OVERLAP
    low, high = grid.origin - reach, grid.origin + grid.period + reach
    return np.concatenate([generator.uniform(low, high, (count, 2)), np.zeros((count, 1))], 1)


def highest_by_ray(terrain, points):
    """Returns the heights (n) at which rays from above first meet the boxes."""
    found = np.full(len(points), -np.inf)
    for box in terrain.boxes():
        start = (points - box.centre + np.array([0.0, 0.0, 10.0])) @ box.rotation
        way = np.array([0.0, 0.0, -1.0]) @ box.rotation
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.stack([(-box.size / 2 - start) / way, (box.size / 2 - start) / way])
        beside = (way == 0.0) & (np.abs(start) > box.size / 2)
        along = (way == 0.0) & ~beside
        enters = np.where(along, -np.inf, np.where(beside, np.inf, ends.min(axis=0))).max(axis=1)
        leaves = np.where(along, np.inf, np.where(beside, -np.inf, ends.max(axis=0))).min(axis=1)
        found = np.where(enters <= leaves, np.maximum(found, 10.0 - enters), found)
    return found


@pytest.mark.parametrize("name", ROUGH)
def test_the_height_is_that_of_the_highest_box(name, generator):
    points = places(ROUGH[name], 1500, generator)
    errors = np.abs(Ground([ROUGH[name]]).height(points) - highest_by_ray(ROUGH[name], points))
    if name in UPRIGHT:
        assert errors.max() < 1e-12
    else:
        # Tilted boxes lean over the borders of their neighbours.
        assert np.mean(errors > 1e-12) < 0.02
        assert errors.max() < 0.02


@pytest.mark.parametrize("name", ROUGH)
def test_the_ground_repeats(name, generator):
    ground, grid = Ground([ROUGH[name]]), grid_of(ROUGH[name])
    points = places(ROUGH[name], 300, generator)
    whole = np.array([[3], [-7]]) * [1.0, 1.0]
    for periods in whole:
        moved = points + np.append(periods * grid.period, 0.0)
        rise = periods[0] * grid.rise
        np.testing.assert_allclose(ground.height(moved), ground.height(points) + rise, atol=1e-9)


@pytest.mark.parametrize("name", ROUGH)
def test_spheres_are_as_far_as_the_nearest_point_of_the_boxes(name, generator):
    terrain, radius = ROUGH[name], 0.02
    ground = Ground([terrain])
    centres = places(terrain, 200, generator)
    centres[:, 2] = ground.height(centres) + generator.uniform(-0.01, 0.03, len(centres))
    outside = np.full(len(centres), np.inf)
    for box in terrain.boxes():
        local = (centres - box.centre) @ box.rotation
        beyond = np.abs(local) - box.size / 2
        gap = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
        outside = np.minimum(outside, np.where(gap > 0.0, gap, beyond.max(axis=1)))
    found = ground.clearance(centres[:, None], radius)[:, 0]
    near = outside < 1.25 * radius
    assert near.sum() > 50
    np.testing.assert_allclose(found[near], outside[near] - radius, atol=1e-12)
    assert (found[~near] > 0.0).all()


@pytest.mark.parametrize("name", ROUGH)
def test_robots_start_just_on_the_ground_and_nothing_of_them_inside(name, generator):
    terrains = [Terrain(), ROUGH[name]]
    which = np.arange(300) % 2
    ground = Ground(terrains, which)
    states = Randomization().initial_states(A1, 300, generator, ground)
    feet = ground.clearance(kinematics.world_feet(A1, states), A1.foot_radius)
    np.testing.assert_allclose(feet.min(axis=1), 0.0, atol=1e-8)
    assert (feet >= 0.0).all()
    assert (ground.clearances(A1, states, 0.9).body > 0.0).all()
    away = ground.periods(states)
    np.testing.assert_allclose(away, 0.0, atol=1e-12)
    assert not states[::2, quadruped.POSITION][:, :2].any()


def test_heights_of_robots_are_above_their_own_ground():
    ground = Ground([Terrain(), ROUGH["steps"]], np.array([0, 1, 1]))
    states = np.tile(kinematics.standing_state(A1), (3, 1))
    # The third robot stands in the middle of the upper landing, a landing and three steps ahead.
    states[2, quadruped.POSITION] += [2.1, 0.0, 4 * 0.08]
    feet = ground.foot_heights(A1, states)
    np.testing.assert_allclose(feet, np.tile(feet[0], (3, 1)), atol=1e-12)
    heights = ground.clearances(A1, states, 0.5).trunk
    np.testing.assert_allclose(heights, heights[0])
    one = ground.of_robots(np.array([2]))
    np.testing.assert_allclose(one.clearances(A1, states[2:], 0.5).trunk, heights[:1])


def test_a_trunk_over_an_edge_is_as_high_as_its_legs_hold_it():
    ground = Ground([ROUGH["steps"]])
    state = kinematics.standing_state(A1)
    low = ground.clearances(A1, state, 0.5).trunk
    # The trunk's centre and the front feet are over the first step; the hind feet are not.
    state[quadruped.POSITION] += [0.65, 0.0, 0.08]
    feet = kinematics.world_feet(A1, state)
    np.testing.assert_allclose(ground.height(feet), [0.08, 0.08, 0.0, 0.0])
    np.testing.assert_allclose(ground.height(state[None, quadruped.POSITION]), [0.08])
    np.testing.assert_allclose(ground.clearances(A1, state, 0.5).trunk, low + 0.04)


def test_on_a_plane_everything_is_as_above_z_0(random_states):
    states, plane = random_states(50), Ground([Terrain(slope=9.0, direction=40.0)])
    states[:, quadruped.POSITION][:, 2] = np.linspace(0.2, 0.45, 50)
    np.testing.assert_array_equal(
        plane.foot_heights(A1, states), kinematics.foot_heights(A1, states)
    )
    own, bare = plane.clearances(A1, states, 0.9), kinematics.clearances(A1, states, 0.9)
    for part, expected in zip(own, bare, strict=True):
        np.testing.assert_array_equal(part, expected)
    rough = Ground([Terrain(patches=0.5)])
    np.testing.assert_array_equal(
        rough.clearances(A1, states, 0.9).feet, rough.foot_heights(A1, states)
    )
    np.testing.assert_allclose(
        rough.foot_heights(A1, states), plane.foot_heights(A1, states), atol=1e-12
    )
    touching = plane.touching(A1, states)
    assert 0 < touching.sum() < touching.size
    np.testing.assert_array_equal(rough.touching(A1, states), touching)


@pytest.mark.parametrize(("slope", "direction"), [(0.0, 0.0), (10.0, 0.0), (20.0, 130.0)])
def test_gravity_leans_away_from_where_a_slope_rises(slope, direction):
    gravity = Terrain(slope=slope, direction=direction).gravity
    assert np.linalg.norm(gravity) == pytest.approx(GRAVITY)
    assert -gravity[2] / GRAVITY == pytest.approx(np.cos(np.radians(slope)))
    uphill = [np.cos(np.radians(direction)), np.sin(np.radians(direction))]
    assert -gravity[:2] @ uphill / GRAVITY == pytest.approx(np.sin(np.radians(slope)))


@pytest.mark.parametrize(
    ("settings", "key"),
    [
        ({"kind": "ice"}, "kind"),
        ({"kind": "blocks", "cell": 0.0}, "cell"),
        ({"kind": "blocks", "height": 0.1}, "height"),
        ({"amplitude": 0.1}, "amplitude"),
        ({"kind": "steps", "height": -0.05}, "height"),
        ({"kind": "uneven", "wavelength": 5.0}, "wavelength"),
    ],
)
def test_ground_that_cannot_be_is_refused_by_its_key(settings, key):
    with pytest.raises(InputError, match=f"terrain: {key}"):
        Terrain(**settings)
