"""The joints' sensors."""

import numpy as np
import pytest

from glassgait.models.robots import quadruped
from glassgait.models.task.observation import JOINT_NOISE
from glassgait.systems.joint_sensor import JointSensor


def measured(system, context):
    return system.get_joints_output_port().Eval(context)


def test_without_errors_it_measures_the_joints(random_states, fix_inputs):
    (state,) = random_states(1)
    true = [state[quadruped.JOINT_POSITION], state[quadruped.JOINT_VELOCITY]]
    system = JointSensor()
    np.testing.assert_array_equal(
        measured(system, fix_inputs(system, state=state)), np.concatenate(true)
    )


def test_noise_of_one_half_is_none_and_of_one_is_the_half_width(standing, fix_inputs):
    system = JointSensor()
    quiet = measured(system, fix_inputs(system, state=standing))
    none = fix_inputs(system, state=standing, uniform_noise=np.full(24, 0.5))
    np.testing.assert_array_equal(measured(system, none), quiet)
    most = fix_inputs(system, state=standing, uniform_noise=np.ones(24))
    np.testing.assert_allclose(measured(system, most) - quiet, JOINT_NOISE)


def test_noise_is_scaled_by_its_factor_and_biases_are_added_to_positions(standing, fix_inputs):
    bias = np.linspace(-0.02, 0.02, 12)
    noisy = {"state": standing, "uniform_noise": np.ones(24)}
    for factor in (0.0, 1.0, 2.0):
        system = JointSensor(factor)
        plain = measured(system, fix_inputs(system, state=standing))
        context = fix_inputs(system, **noisy, encoder_bias=bias)
        expected = factor * JOINT_NOISE + np.concatenate([bias, np.zeros(12)])
        np.testing.assert_allclose(measured(system, context) - plain, expected, atol=1e-15)


def test_clones_measure_their_own_robot(standing, fix_inputs):
    system = JointSensor()
    context = fix_inputs(system, state=standing)
    clone = fix_inputs(system, context.Clone(), state=np.zeros(37))
    assert not measured(system, clone).any()
    assert measured(system, context).any()


@pytest.mark.parametrize("factor", [-1.0, float("nan"), float("inf")])
def test_refuses_a_factor_that_is_none(factor):
    with pytest.raises(ValueError, match="noise_factor"):
        JointSensor(factor)
