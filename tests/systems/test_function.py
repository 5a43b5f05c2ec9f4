"""Systems that are functions of their inputs, and what they are converted for."""

import numpy as np
import pytest
from pydrake.autodiffutils import AutoDiffXd, ExtractGradient, ExtractValue, InitializeAutoDiff
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Multiplexer

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.station import MakeStation
from glassgait.models.policies.library import load_student
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.observation import N_ESTIMATED, ObservationLayout
from glassgait.systems.body_state_sensor import BodyStateSensor
from glassgait.systems.function import FunctionSystem
from glassgait.systems.joint_sensor import JointSensor
from glassgait.systems.joint_targets import JointTargets
from glassgait.systems.proprioception import Proprioception
from glassgait.systems.symbolic_policy import make_symbolic_policy

A1 = load_robot()


LAYOUT = ObservationLayout(2, imu=True)


def saxpy():
    return FunctionSystem(
        inputs={"x": 2, "y": 2},
        output=("sum", 2),
        function=lambda x, y=1.0: 2.0 * x + y,
        optional=("y",),
    )


def from_state_to_targets():
    """A controller between the plant's state and the joints' targets, all else exported too."""
    builder = DiagramBuilder()
    sensor = builder.AddNamedSystem("body_state_sensor", BodyStateSensor(A1))
    joints = builder.AddNamedSystem("joint_sensor", JointSensor())
    proprioception = builder.AddNamedSystem("proprioception", Proprioception(A1, LAYOUT))
    observation = builder.AddSystem(Multiplexer([LAYOUT.n_proprioceptive, N_ESTIMATED]))
    policy = builder.AddSystem(make_symbolic_policy(load_student("trot", "statewise_symbolic")))
    targets = builder.AddSystem(JointTargets(A1, quadruped.JOINTS[::-1]))
    builder.Connect(proprioception.get_proprioception_output_port(), observation.get_input_port(0))
    builder.Connect(sensor.get_body_state_output_port(), observation.get_input_port(1))
    builder.Connect(observation.get_output_port(), policy.get_input_port())
    builder.Connect(policy.get_output_port(), targets.get_action_input_port())
    state = builder.ExportInput(sensor.get_state_input_port(), "state")
    builder.ConnectInput(state, joints.get_state_input_port())
    builder.Connect(joints.get_joints_output_port(), proprioception.get_joints_input_port())
    inputs = ("command", "commanded_dwell", "previous_action", "rm_state", "rm_iterations", "imu")
    for name in inputs:
        builder.ExportInput(proprioception.GetInputPort(name), name)
    builder.ExportOutput(targets.get_desired_state_output_port(), "desired_state")
    return builder.Build()


def desired_state(diagram, state):
    context = diagram.CreateDefaultContext()
    values = {
        "state": state,
        "command": np.array([0.4, 0.1]),
        "commanded_dwell": np.array([8.0]),
        "previous_action": np.full(12, 0.1),
        "rm_state": np.array([0.0, 1.0]),
        "rm_iterations": np.array([3.0]),
        "imu": np.array([0.1, -0.2, 0.3, 0, 0, 0.2, 0.05, 0.1, -0.99]),
    }
    for name, value in values.items():
        diagram.GetInputPort(name).FixValue(context, value)
    return diagram.GetOutputPort("desired_state").Eval(context)


def test_optional_ports_may_stay_unconnected_and_others_not(fix_inputs):
    system = saxpy()
    context = fix_inputs(system, x=[1.0, 2.0])
    np.testing.assert_array_equal(system.get_output_port().Eval(context), [3, 5])
    fix_inputs(system, context, y=[0.0, 3.0])
    np.testing.assert_array_equal(system.get_output_port().Eval(context), [2, 7])
    with pytest.raises(RuntimeError, match=r"\(x\)"):
        system.get_output_port().Eval(fix_inputs(system, y=[0.0, 3.0]))


@pytest.mark.parametrize(
    "system",
    [
        saxpy(),
        JointTargets(A1, quadruped.JOINTS),
        JointSensor(),
        BodyStateSensor(A1),
        Proprioception(A1, LAYOUT),
    ],
    ids=lambda system: type(system).__name__,
)
def test_the_twin_with_derivatives_has_the_same_values(system, generator):
    system.set_name("mine")
    twin = system.ToAutoDiffXd()
    assert twin.get_name() == "mine"
    context, twins = system.CreateDefaultContext(), twin.CreateDefaultContext()
    for index in range(system.num_input_ports()):
        port = system.get_input_port(index)
        value = generator.normal(size=port.size())
        port.FixValue(context, value)
        twin.GetInputPort(port.get_name()).FixValue(twins, value.astype(AutoDiffXd))
    np.testing.assert_allclose(
        ExtractValue(twin.get_output_port().Eval(twins))[:, 0],
        system.get_output_port().Eval(context),
        rtol=1e-14,
        atol=1e-15,
    )


def test_targets_differentiate_by_the_plants_state(random_states):
    diagram = from_state_to_targets()
    (state,) = random_states(1)
    found = desired_state(diagram.ToAutoDiffXd(), InitializeAutoDiff(state)[:, 0])
    np.testing.assert_allclose(ExtractValue(found)[:, 0], desired_state(diagram, state), atol=1e-13)
    gradient, step = ExtractGradient(found), 1e-6
    for i, column in enumerate(gradient.T):
        shift = step * np.eye(len(state))[i]
        ahead, behind = (desired_state(diagram, state + sign * shift) for sign in (1, -1))
        np.testing.assert_allclose(column, (ahead - behind) / (2 * step), rtol=1e-4, atol=1e-5)
    assert np.abs(gradient[:12]).max() > 0.1


def test_the_loop_does_not_convert_since_the_plant_would_lose_its_control(trot):
    loop = MakeLocomotion(trot, Scenario(command=FixedCommand(), sensor_noise=0.0))
    with pytest.raises(RuntimeError, match="ActionHold"):
        loop.ToAutoDiffXd()
    station = MakeStation(A1)
    for diagram, controlled in ((station, True), (station.ToAutoDiffXd(), False)):
        plant = diagram.GetSubsystemByName("plant")
        actuators = map(plant.get_joint_actuator, plant.GetJointActuatorIndices())
        assert {actuator.has_controller() for actuator in actuators} == {controlled}
