"""The state estimator."""

import numpy as np
import pytest

from glassgait.systems.state_estimator import StateEstimator


def test_gives_what_its_function_estimates(fix_inputs):
    system = StateEstimator(lambda own: 2 * own[:7], 42)
    context = fix_inputs(system, proprioception=np.arange(42.0))
    port = system.get_body_state_output_port()
    np.testing.assert_array_equal(port.Eval(context), 2 * np.arange(7.0))


def test_remembers_the_foot_heights_of_the_instant_before(fix_inputs, latch):
    system = StateEstimator(lambda own: own[:7], 42)
    context = fix_inputs(system, proprioception=np.arange(42.0))
    clone = context.Clone()
    port = system.get_previous_foot_height_output_port()
    assert port.Eval(context).tolist() == [0, 0, 0, 0]
    latch(system, context)
    assert port.Eval(context).tolist() == [3, 4, 5, 6]
    assert port.Eval(clone).tolist() == [0, 0, 0, 0]


def test_contexts_share_the_function_but_not_the_observation(fix_inputs):
    system = StateEstimator(lambda own: own[:7], 42)
    context = fix_inputs(system, proprioception=np.ones(42))
    clone = fix_inputs(system, context.Clone(), proprioception=np.zeros(42))
    port = system.get_body_state_output_port()
    np.testing.assert_array_equal(port.Eval(clone), 0.0)
    np.testing.assert_array_equal(port.Eval(context), 1.0)


@pytest.mark.parametrize("length", [0, -1])
def test_refuses_to_observe_nothing(length):
    with pytest.raises(ValueError, match=f"n_proprioceptive is {length}"):
        StateEstimator(lambda own: own[:7], length)
