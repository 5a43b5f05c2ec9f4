"""Draws of initial states, noise and pushes."""

import numpy as np
import pytest

from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.ground import LEVEL_GROUND, Ground
from glassgait.models.task.randomization import Randomization
from glassgait.models.task.terrain import Terrain

A1 = load_robot()


def test_initial_states_stand_on_a_foot_with_joints_inside_their_limits(generator):
    states = Randomization().initial_states(A1, 500, generator)
    joints = states[:, quadruped.JOINT_POSITION]
    assert np.all(joints >= A1.lower_limits)
    assert np.all(joints <= A1.upper_limits)
    np.testing.assert_allclose(kinematics.foot_heights(A1, states).min(axis=1), 0, atol=1e-12)
    assert 0.4 < np.abs(states[:, quadruped.LINEAR_VELOCITY]).max() <= 0.5


@pytest.mark.parametrize("ground", [LEVEL_GROUND, Ground([Terrain("blocks")])])
def test_robots_face_where_they_are_drawn_to(generator, ground):
    facing = []
    for heading in (0.0, 90.0, 180.0):
        states = Randomization(heading=heading).initial_states(A1, 500, generator, ground)
        ahead = kinematics.rotation_matrix(states[:, quadruped.QUATERNION])[:, :2, 0]
        facing.append(np.degrees(np.arctan2(ahead[:, 1], ahead[:, 0])))
        feet = ground.clearance(kinematics.world_feet(A1, states), A1.foot_radius)
        np.testing.assert_allclose(feet.min(axis=1), 0, atol=1e-3)
    assert np.all(facing[0] == 0.0)
    assert 85.0 < facing[1].max() <= 90.0 and -90.0 <= facing[1].min() < -85.0
    assert np.histogram(facing[2], 8, (-180.0, 180.0))[0].min() > 30


def test_noise_stays_within_its_half_widths(generator):
    noise = Randomization().joint_noise(2000, generator)
    assert 0.0099 < np.abs(noise[:, :12]).max() <= 0.01
    assert 1.49 < np.abs(noise[:, 12:]).max() <= 1.5


def test_pushes_are_horizontal_and_come_about_every_interval(generator):
    pushes = Randomization(push_interval=0.2).pushes(20_000, generator)
    assert np.all(pushes[:, 2] == 0)
    assert abs(np.mean(pushes.any(axis=1)) - 0.1) < 0.01
    assert np.abs(pushes).max() <= 1.0
