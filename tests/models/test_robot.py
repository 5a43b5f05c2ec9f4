"""Robots: their files, compared with their descriptions, and their joint law."""

import copy
import pickle
import re

import numpy as np
import pytest

from glassgait.models.errors import InputError
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import JointLaw

A1 = load_robot()


def test_limited_targets_are_the_nearest_within_the_joints_ranges(generator):
    action = generator.normal(size=(50, 12), scale=8.0)
    asked = A1.joint_targets(action)
    followed = A1.joint_targets(action, limited=True)
    assert np.any(followed != asked)
    within = (asked >= A1.lower_limits) & (asked <= A1.upper_limits)
    np.testing.assert_array_equal(followed[within], asked[within])
    ends = np.where(asked < A1.lower_limits, A1.lower_limits, A1.upper_limits)
    np.testing.assert_array_equal(followed[~within], ends[~within])
    assert np.all(np.isnan(A1.joint_targets(np.full(12, np.nan), limited=True)))


def test_torque_follows_the_pd_law_up_to_the_effort_of_each_joint():
    zero = np.zeros(12)
    law, stance = JointLaw((20.0, 0.5)), A1.default_stance
    torque = law.torque(A1, action=zero, position=stance - 0.1, velocity=zero + 2.0)
    np.testing.assert_allclose(torque, 1.0)
    torque = law.torque(A1, action=zero, position=stance - 5.0, velocity=zero)
    np.testing.assert_allclose(torque, A1.effort[0])
    go2 = load_robot("go2")
    assert (go2.lower_limits[1], go2.lower_limits[10]) == (-1.5708, -0.5236)
    np.testing.assert_array_equal(go2.effort[:3], [23.7, 23.7, 45.43])


def test_joints_are_found_by_name_and_by_index():
    assert [quadruped.joint_index(joint) for joint in ("FL_calf", 2, np.int64(2))] == [2, 2, 2]
    for bad in ("FL_knee", "", 12, -1, 2.0, True, None, ["FL_hip"], np.zeros(2)):
        with pytest.raises(InputError, match="unknown joint"):
            quadruped.joint_index(bad)


def test_a_robot_of_ones_own_is_loaded_by_its_file_and_is_one_object(write_robot):
    dog = load_robot(write_robot())
    assert (dog.name, dog.source) == ("dog", str(dog.path))
    np.testing.assert_array_equal(dog.hip_origin, A1.hip_origin)
    assert load_robot(dog.source) is dog is copy.deepcopy(dog)
    assert pickle.loads(pickle.dumps(dog)) is dog
    assert A1.source == "a1"


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        ("robot.yaml", "FL: [0.1, 0.8, -1.5]", "FL: [0.1, 0.8, -0.5]", "stance has FL_calf"),
        ("robot.yaml", "  FL: [0.1", "  LF: [0.1", "stance has the legs LF"),
        ("robot.yaml", "damping: 1.0", "damping: -1.0", "damping is -1.0"),
        ("robot.yaml", "damping: 1.0", "mass: 12.0", "'mass' is read from the URDF"),
        ("robot.yaml", "name: dog", "name: go2", "name is 'go2'"),
        ("robot.yaml", "description: a1.urdf", "description: none.urdf", "none.urdf"),
        ("robot.yaml", "description: a1.urdf", "", "lacks the key 'description'"),
        ("a1.urdf", 'axis xyz="1 0 0"', 'axis xyz="-1 0 0"', "the axis of joint FL_hip"),
        ("a1.urdf", 'joint name="FL_hip"', 'joint name="FL_roll"', "moving joints are FL_roll"),
        (
            "a1.urdf",
            'parent link="trunk"',
            'parent link="FR_hip"',
            "does not hang from link FR_hip",
        ),
        ("a1.urdf", '"FL_foot"><origin xyz="0 0 -0.2"', '""><origin xyz="0 .1 0"', "hang straight"),
        ("a1.urdf", '<box size="0.267 0.194 0.114"', "<mesh", "link trunk collides by mesh"),
        ("a1.urdf", 'value="0.211"', 'value="1e-300"', "link FL_calf has 1e-300 kg"),
        ("a1.urdf", 'izz="4.292802655e-05"', 'izz="1"', "principal moments"),
        ("a1.urdf", 'effort="33.5"', 'effort="1e308"', "effort of limit of joint FL_hip"),
        ("robot.yaml", "damping: 1.0", "joints: {FL: [a, b, c]}", "key 'joints'"),
        ("a1.urdf", 'origin xyz="0 0.0838 0"', 'origin xyz="0 0.08 0"', "thigh_offset of FR"),
        ("a1.urdf", 'origin xyz="0 0.0838 0"', 'origin xyz="0.1 0.0838 0"', "hang straight down"),
        ("a1.urdf", 'upper="0.8029" effort="33.5"', 'upper="-1" effort="33.5"', "position_limits"),
        ("a1.urdf", 'effort="33.5"', 'effort="0"', "effort_limits"),
        ("a1.urdf", "</robot>", "", "not a URDF"),
        ("a1.urdf", 'mass value="6"', 'mass value="none"', "mass"),
    ],
)
def test_bad_files_are_refused_by_key(write_robot, file, old, new, message):
    with pytest.raises(InputError, match=re.escape(message)):
        load_robot(write_robot(file, old, new))
