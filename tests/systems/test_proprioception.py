"""The proprioception."""

import numpy as np
import pytest

from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import load_robot
from glassgait.models.task.observation import JOINT_NOISE, ObservationLayout, proprioception
from glassgait.systems.proprioception import Proprioception

A1 = load_robot()


LAYOUT = ObservationLayout(4)


def inputs(standing):
    return {
        "state": standing,
        "command": np.array([0.5, -0.2]),
        "commanded_dwell": 9,
        "previous_action": np.arange(12.0),
        "rm_state": np.eye(4)[2],
        "rm_iterations": 3,
    }


def test_without_noise_it_is_the_models_function(standing, fix_inputs):
    system = Proprioception(A1, LAYOUT)
    context = fix_inputs(system, **inputs(standing))
    expected = proprioception(
        A1,
        command=np.array([0.5, -0.2]),
        joint_position=standing[quadruped.JOINT_POSITION],
        joint_velocity=standing[quadruped.JOINT_VELOCITY],
        previous_action=np.arange(12.0),
        rm_state=np.eye(4)[2],
        rm_iterations=np.array(3.0),
        commanded_dwell=np.array(9.0),
    )
    np.testing.assert_array_equal(system.get_proprioception_output_port().Eval(context), expected)


def test_noise_of_one_half_is_none_and_of_one_is_the_half_width(standing, fix_inputs):
    system = Proprioception(A1, LAYOUT)
    port = system.get_proprioception_output_port()
    quiet = port.Eval(fix_inputs(system, **inputs(standing)))
    none = fix_inputs(system, **inputs(standing), uniform_noise=np.full(24, 0.5))
    np.testing.assert_array_equal(port.Eval(none), quiet)
    most = fix_inputs(system, **inputs(standing), uniform_noise=np.ones(24))
    np.testing.assert_allclose((port.Eval(most) - quiet)[2:14], JOINT_NOISE[:12])


def test_noise_is_scaled_by_its_factor(standing, fix_inputs):
    noisy = {**inputs(standing), "uniform_noise": np.ones(24)}
    quiet, plain, double = (
        system.get_proprioception_output_port().Eval(fix_inputs(system, **noisy))
        for system in (Proprioception(A1, LAYOUT, factor) for factor in (0.0, 1.0, 2.0))
    )
    np.testing.assert_allclose((plain - quiet)[2:14], JOINT_NOISE[:12])
    np.testing.assert_allclose(double - quiet, 2 * (plain - quiet))


def test_clones_observe_their_own_robot(standing, fix_inputs):
    system = Proprioception(A1, LAYOUT)
    context = fix_inputs(system, **inputs(standing))
    clone = fix_inputs(system, context.Clone(), command=[0.1, 0.1])
    port = system.get_proprioception_output_port()
    np.testing.assert_array_equal(port.Eval(clone)[:2], [0.1, 0.1])
    np.testing.assert_array_equal(port.Eval(context)[:2], [0.5, -0.2])


@pytest.mark.parametrize("factor", [-1.0, float("nan"), float("inf")])
def test_refuses_a_factor_that_is_none(factor):
    with pytest.raises(ValueError, match="noise_factor"):
        Proprioception(A1, LAYOUT, factor)
