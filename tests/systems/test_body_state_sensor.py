"""The sensor that stands in for the state estimator."""

import numpy as np

from glassgait.models.robots.library import load_robot
from glassgait.models.task.observation import body_state
from glassgait.systems.body_state_sensor import BodyStateSensor

A1 = load_robot()


def test_gives_the_true_values(random_states, fix_inputs):
    system = BodyStateSensor(A1)
    (state,) = random_states(1)
    context = fix_inputs(system, state=state)
    np.testing.assert_array_equal(
        system.get_body_state_output_port().Eval(context), body_state(A1, state)
    )


def test_clones_see_their_own_robot(random_states, fix_inputs):
    system = BodyStateSensor(A1)
    first, second = random_states(2)
    context = fix_inputs(system, state=first)
    clone = fix_inputs(system, context.Clone(), state=second)
    port = system.get_body_state_output_port()
    np.testing.assert_array_equal(port.Eval(clone), body_state(A1, second))
    np.testing.assert_array_equal(port.Eval(context), body_state(A1, first))
