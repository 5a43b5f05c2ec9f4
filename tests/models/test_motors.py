"""Motors: joints are numbered by name, and only what joints may be given is sent."""

import numpy as np
import pytest

from glassgait.models.link.motors import (
    MotorCommand,
    damping,
    foot_numbers,
    may_be_given,
    motor_numbers,
    pack_low_cmd,
    unpack_low_cmd,
)
from glassgait.models.link.unitree_messages import is_sound
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.quadruped import JOINTS, LEGS

VENDOR_LEGS = ("FR", "FL", "RR", "RL")
VENDOR = [f"{leg}_{joint}" for leg in VENDOR_LEGS for joint in ("hip", "thigh", "calf")]
"""Motors: joints are numbered by name, and only what joints may be given is sent."""


VENDOR = [
    f"{leg}_{joint}" for leg in ("FR", "FL", "RR", "RL") for joint in ("hip", "thigh", "calf")
]
"""Motors 0 to 11, as constants of the SDK's examples number them (FR_0, FR_1, …)."""

ROBOTS = ("a1", "go2")


@pytest.mark.parametrize("name", ROBOTS)
def test_every_joint_has_the_motor_of_its_name(name):
    numbers = motor_numbers(load_robot(name))
    assert [VENDOR[number] for number in numbers] == list(JOINTS)
    feet = foot_numbers(load_robot(name))
    assert [VENDOR_LEGS[number] for number in feet] == list(LEGS)


@pytest.mark.parametrize("joint", range(12))
def test_a_command_of_one_joint_moves_its_motor_alone(joint):
    robot = load_robot("go2")
    targets = np.array(robot.default_stance)
    targets[joint] += 0.05
    still = pack_low_cmd(robot, MotorCommand.to(robot.default_stance, (40.0, 1.0)))
    moved = pack_low_cmd(robot, MotorCommand.to(targets, (40.0, 1.0)))
    (changed,) = np.flatnonzero(still["motor_cmd"]["q"] != moved["motor_cmd"]["q"])
    assert VENDOR[changed] == JOINTS[joint]


def test_a_command_is_what_the_firmware_expects(generator):
    robot = load_robot("go2")
    targets = generator.uniform(robot.lower_limits, robot.upper_limits)
    message = pack_low_cmd(robot, MotorCommand.to(targets, (40.0, 1.0)))
    assert is_sound(message)
    assert message["head"].tolist() == [0xFE, 0xEF]
    assert message["level_flag"] == 0xFF
    motors = message["motor_cmd"]
    assert motors["mode"].tolist() == [1] * 12 + [0] * 8
    assert set(motors["kp"][:12]) == {40.0}
    assert set(motors["kd"][:12]) == {1.0}
    assert not any(motors[name].any() for name in ("dq", "tau"))
    command = unpack_low_cmd(robot, message)
    assert command is not None
    np.testing.assert_allclose(command.q, targets, atol=1e-6)


def test_limits_themselves_survive_single_precision():
    for name in ROBOTS:
        robot = load_robot(name)
        for limits in (robot.lower_limits, robot.upper_limits):
            message = pack_low_cmd(robot, MotorCommand.to(limits, (40.0, 1.0)))
            command = unpack_low_cmd(robot, message)
            assert command is not None
            assert may_be_given(robot, command)


def test_a_motor_that_is_not_driven_makes_no_command():
    robot = load_robot("go2")
    message = pack_low_cmd(robot, damping(robot.default_stance, 5.0))
    message["motor_cmd"]["mode"][4] = 0
    assert unpack_low_cmd(robot, message) is None


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("q", np.nan),
        ("q", 1e30),
        ("q", -3.0),
        ("dq", np.inf),
        ("dq", 1e4),
        ("tau", np.nan),
        ("tau", 46.0),
        ("kp", -1.0),
        ("kp", 1e6),
        ("kp", np.nan),
        ("kd", -1.0),
        ("kd", 51.0),
        ("kd", np.nan),
    ],
)
@pytest.mark.parametrize("joint", [0, 5, 11])
def test_what_joints_may_not_be_given_is_not_sent(name, value, joint):
    robot = load_robot("go2")
    command = MotorCommand.to(robot.default_stance, (40.0, 1.0))
    assert may_be_given(robot, command)
    values = np.array(getattr(command, name))
    values[joint] = value
    wrong = command._replace(**{name: values})
    assert not may_be_given(robot, wrong)
    with pytest.raises(ValueError, match="motor command"):
        pack_low_cmd(robot, wrong)


def test_damping_takes_any_finite_position_and_no_other():
    robot = load_robot("go2")
    assert may_be_given(robot, damping(np.full(12, 9.0), 5.0))
    assert not may_be_given(robot, damping(np.full(12, np.nan), 5.0))
