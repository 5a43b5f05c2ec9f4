"""The state estimator, and the sensor that stands in for it."""

import numpy as np

from models.task.observation import body_state
from systems.body_state_sensor import BodyStateSensor
from systems.state_estimator import StateEstimator


def test_estimator_ports(port_sizes, feedthrough):
    system = StateEstimator(lambda own: own[:7], 42)
    assert port_sizes(system) == ({"proprioception": 42}, {"body_state": 7})
    assert feedthrough(system) == {("proprioception", "body_state")}


def test_estimator_gives_what_its_function_estimates(fix_inputs):
    system = StateEstimator(lambda own: 2 * own[:7], 42)
    context = fix_inputs(system, proprioception=np.arange(42.0))
    port = system.get_body_state_output_port()
    np.testing.assert_array_equal(port.Eval(context), 2 * np.arange(7.0))


def test_sensor_ports(port_sizes, feedthrough):
    system = BodyStateSensor()
    assert port_sizes(system) == ({"state": 37}, {"body_state": 7})
    assert feedthrough(system) == {("state", "body_state")}


def test_sensor_gives_the_true_values(random_states, fix_inputs):
    system = BodyStateSensor()
    (state,) = random_states(1)
    context = fix_inputs(system, state=state)
    np.testing.assert_array_equal(
        system.get_body_state_output_port().Eval(context), body_state(state)
    )
