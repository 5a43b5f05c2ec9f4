"""The proprioception."""

import numpy as np
import pytest

from glassgait.models.robots.library import load_robot
from glassgait.models.task.observation import ObservationLayout, proprioception
from glassgait.systems.proprioception import Proprioception

A1 = load_robot()
INPUTS = {
    "joints": np.linspace(-1.0, 1.0, 24),
    "command": np.array([0.5, -0.2]),
    "commanded_dwell": 9,
    "previous_action": np.arange(12.0),
    "rm_state": np.eye(4)[2],
    "rm_iterations": 3,
}


@pytest.mark.parametrize("imu", [None, np.arange(9.0)])
def test_it_is_the_models_function(imu, fix_inputs):
    system = Proprioception(A1, ObservationLayout(4, imu=imu is not None))
    reading = {} if imu is None else {"imu": imu}
    context = fix_inputs(system, **INPUTS, **reading)
    expected = proprioception(
        A1,
        command=np.array([0.5, -0.2]),
        joint_position=INPUTS["joints"][:12],
        joint_velocity=INPUTS["joints"][12:],
        previous_action=np.arange(12.0),
        rm_state=np.eye(4)[2],
        rm_iterations=np.array(3.0),
        commanded_dwell=np.array(9.0),
        imu=imu,
    )
    np.testing.assert_array_equal(system.get_proprioception_output_port().Eval(context), expected)


def test_where_targets_are_limited_those_that_joints_followed_are_observed(fix_inputs):
    layout = ObservationLayout(4)
    system = Proprioception(A1, layout, limited=True)
    asked = np.resize([1e30, -1e30, 0.5, np.nan], 12)
    context = fix_inputs(system, **INPUTS | {"previous_action": asked})
    entries = [i for i, own in enumerate(layout.entries) if own.group == "previous action"]
    followed = system.get_proprioception_output_port().Eval(context)[entries]
    np.testing.assert_allclose(
        A1.joint_targets(followed), A1.joint_targets(asked, limited=True), atol=1e-15
    )
    np.testing.assert_array_equal(followed[2::4], asked[2::4])


def test_clones_observe_their_own_robot(fix_inputs):
    system = Proprioception(A1, ObservationLayout(4))
    context = fix_inputs(system, **INPUTS)
    clone = fix_inputs(system, context.Clone(), command=[0.1, 0.1])
    port = system.get_proprioception_output_port()
    np.testing.assert_array_equal(port.Eval(clone)[:2], [0.1, 0.1])
    np.testing.assert_array_equal(port.Eval(context)[:2], [0.5, -0.2])
