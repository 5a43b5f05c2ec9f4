"""What a gait repeats: place and heading are left out, and nothing else is lost."""

import numpy as np
import pytest

from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.heading_frame import (
    COORDINATES,
    from_heading_frame,
    to_heading_frame,
)
from glassgait.models.robots.library import load_robot

A1 = load_robot()


def about_vertical(angle):
    return np.array([np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)])


def product(a, b):
    """Multiplies quaternions (4) and (n, 4)."""
    w, v = a[0], a[1:]
    scalar = w * b[:, :1] - b[:, 1:] @ v[:, None]
    return np.concatenate([scalar, w * b[:, 1:] + b[:, :1] * v + np.cross(v, b[:, 1:])], axis=1)


def moved(states, *, angle, place):
    """Turns robots about the vertical, and puts them elsewhere."""
    states = states.copy()
    turn = about_vertical(angle)
    rotation = kinematics.rotation_matrix(turn)
    states[:, quadruped.QUATERNION] = product(turn, states[:, quadruped.QUATERNION])
    states[:, 4:6] = place
    for part in (quadruped.ANGULAR_VELOCITY, quadruped.LINEAR_VELOCITY):
        states[:, part] = states[:, part] @ rotation.T
    return states


def test_robots_that_stand_and_face_elsewhere_have_the_same_coordinates(random_states):
    states = random_states(20)
    elsewhere = moved(states, angle=2.1, place=(5.0, -3.0))
    assert to_heading_frame(elsewhere) == pytest.approx(to_heading_frame(states), abs=1e-9)


def test_what_is_left_out_is_place_and_heading_alone(random_states):
    states = random_states(20)
    back = from_heading_frame(to_heading_frame(states))
    assert (back[:, 4:6] == 0.0).all()
    assert to_heading_frame(back) == pytest.approx(to_heading_frame(states), abs=1e-9)
    # Feet are as high, and the trunk feels the same speeds.
    for of in (
        lambda x: kinematics.foot_heights(A1, x),
        lambda x: np.stack(kinematics.base_velocity(x)),
    ):
        assert of(back) == pytest.approx(of(states), abs=1e-9)


def test_coordinates_do_not_depend_on_the_length_of_the_quaternion(random_states):
    states = random_states(5)
    longer = states.copy()
    longer[:, quadruped.QUATERNION] *= 1.1
    assert to_heading_frame(longer) == pytest.approx(to_heading_frame(states), abs=1e-12)


@pytest.mark.parametrize(
    ("name", "index"), [("height", 6), ("FL_calf", 9), ("lateral speed", 23), ("FL_hip rate", 25)]
)
def test_names_stand_where_their_values_do(standing, name, index):
    state = standing.copy()
    state[index] += 0.25
    change = to_heading_frame(state) - to_heading_frame(standing)
    assert np.flatnonzero(np.abs(change) > 1e-12).tolist() == [COORDINATES.index(name)]
    assert change[COORDINATES.index(name)] == pytest.approx(0.25)
