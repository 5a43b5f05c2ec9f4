"""Arrays of one shape cannot be swapped by their place in a call."""

import inspect

import numpy as np
import pytest

from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.robots.library import load_robot
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.models.task.observation import proprioception
from glassgait.models.task.reward import step_reward
from glassgait.models.task.reward_machine import RewardMachine
from glassgait.models.task.termination import failures

A1 = load_robot()


@pytest.mark.parametrize(
    ("function", "swappable"),
    [
        (A1.joint_torque, ("target", "position", "velocity")),
        (proprioception, ("joint_position", "joint_velocity", "previous_action")),
        (proprioception, ("rm_iterations", "commanded_dwell")),
        (step_reward, ("previous_joint_velocity", "action", "previous_action")),
        (step_reward, ("foot_contact", "air_time", "fall_speed")),
        (failures, ("action", "previous_action")),
        (RewardMachine.step, ("foot_contact", "foot_height")),
        (GaitSwitch.step, ("requested", "foot_contact", "foot_height", "commanded_dwell")),
    ],
)
def test_arrays_of_one_shape_go_by_name(function, swappable):
    parameters = inspect.signature(function).parameters
    assert {parameters[name].kind for name in swappable} == {inspect.Parameter.KEYWORD_ONLY}


@pytest.mark.parametrize("policy", [AdditivePolicy, BoostedTreesPolicy])
def test_arrays_of_policies_go_by_name(policy):
    assert len(policy.array_specs) > 1
    with pytest.raises(TypeError, match="positional"):
        policy("trot", ("Command X",), *(np.zeros(1) for _ in policy.array_specs))
