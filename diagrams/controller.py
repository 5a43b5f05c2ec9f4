"""What stands between a robot's sensors and the action that its joints are to follow."""

from dataclasses import dataclass

from pydrake.systems.framework import DiagramBuilder, InputPortIndex, OutputPort
from pydrake.systems.primitives import Multiplexer, PortSwitch

from glassgait.models.counterfactuals.question import Intervention
from glassgait.models.errors import InputError
from glassgait.models.policies.controller import (
    AlternatingController,
    AssuredController,
    Controller,
    alone,
    estimator_in_loop,
)
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import N_ESTIMATED, ObservationLayout
from glassgait.systems.action_hold import ActionHold
from glassgait.systems.alternation import AlternationSchedule
from glassgait.systems.assurance_monitor import AssuranceMonitor
from glassgait.systems.body_state_sensor import BodyStateSensor
from glassgait.systems.observation_offset import ObservationOffset
from glassgait.systems.policy import PolicySystem
from glassgait.systems.proprioception import Proprioception
from glassgait.systems.reward_machine import RewardMachineSystem
from glassgait.systems.state_estimator import StateEstimator


@dataclass(frozen=True)
class Sensed:
    """Where a controller's inputs come from.

    Attributes:
        state: The plant's state (37), of which the joints are read, and the trunk only where there
            is no estimator.
        foot_contact: Which feet touch, or did a control step ago (4).
        command: Forward speed and yaw rate (2; m/s, rad/s).
        commanded_dwell: Commanded iterations in a state (1, control steps).
        foot_height: True heights of the feet (4, m), for the reward machine where there is no
            estimator.
        joint_noise: Uniform noise of the joints' sensors (24, in [0, 1]), or None.
    """

    state: OutputPort
    foot_contact: OutputPort
    command: OutputPort
    commanded_dwell: OutputPort
    foot_height: OutputPort | None = None
    joint_noise: OutputPort | None = None


@dataclass(frozen=True)
class ControllerPorts:
    """Parts of a controller that others are connected to.

    Attributes:
        hold: The action hold.
        observation: What is observed (47 + n_states).
        acting: What `AddPolicies` returns; empty where no policy is given: the hold's input is then
            still to be connected.
    """

    hold: ActionHold
    observation: OutputPort
    acting: dict[str, OutputPort]


def AddController(  # noqa: N802
    builder: DiagramBuilder,
    robot: Robot,
    gait: Gait,
    sensed: Sensed,
    *,
    machine: RewardMachineSystem,
    policy: Controller | Policy | None,
    true_body_state: bool = False,
    sensor_noise: float = 1.0,
    intervention: Intervention | None = None,
) -> ControllerPorts:
    """Adds observation, estimator, policies and action hold, and connects the reward machine.

    Args:
        builder: Where they are added.
        robot: The robot.
        gait: The gait that the policy was made for.
        sensed: Where the inputs come from.
        machine: The gait's reward machine.
        policy: The controller. Its estimator gives the observed body state and the foot heights
            that the reward machine reads.
        true_body_state: Whether to observe the true ones instead.
        sensor_noise: Factor on the noise of the joints' sensors.
        intervention: Gives the policy another observation for some control steps.

    Raises:
        InputError: if a policy was made for another gait or observation, or has no estimator where
            the true body state is not asked for.
        ValueError: if there is neither an estimator nor true heights of the feet.
    """
    if isinstance(policy, Policy):
        policy = alone(policy)
    layout = ObservationLayout(gait.n_states)
    for one in policy.policies.values() if policy else ():
        one.check(gait=gait.name, observation_names=layout.names)
    hold = builder.AddNamedSystem("action_hold", ActionHold())
    builder.Connect(sensed.foot_contact, machine.get_foot_contact_input_port())
    builder.Connect(sensed.commanded_dwell, machine.get_commanded_dwell_input_port())
    proprioception = _add_proprioception(
        builder, robot, layout, sensed, sensor_noise, machine, hold
    )
    # What estimates the body state, or else senses it.
    estimator = policy and estimator_in_loop(policy, true_body_state=true_body_state)
    if estimator is None:
        if sensed.foot_height is None:
            raise ValueError("controller: there is no estimator; connect true heights of the feet")
        body_state = builder.AddNamedSystem("body_state_sensor", BodyStateSensor(robot))
        builder.Connect(sensed.state, body_state.get_state_input_port())
        sensed_height = sensed.foot_height
    else:
        body_state = StateEstimator(estimator, layout.n_proprioceptive)
        builder.AddNamedSystem("state_estimator", body_state)
        builder.Connect(
            proprioception.get_proprioception_output_port(),
            body_state.get_proprioception_input_port(),
        )
        sensed_height = body_state.get_previous_foot_height_output_port()
    builder.Connect(sensed_height, machine.get_foot_height_input_port())
    observation = Multiplexer([layout.n_proprioceptive, N_ESTIMATED])
    builder.AddNamedSystem("observation", observation)
    builder.Connect(proprioception.get_proprioception_output_port(), observation.get_input_port(0))
    builder.Connect(body_state.get_body_state_output_port(), observation.get_input_port(1))
    acting: dict[str, OutputPort] = {}
    if policy is not None:
        given = _given_observation(builder, observation.get_output_port(), intervention)
        acting = AddPolicies(builder, policy, given)
        builder.Connect(acting["actions"], hold.get_action_input_port())
    return ControllerPorts(hold, observation.get_output_port(), acting)


def AddPolicies(  # noqa: N802
    builder: DiagramBuilder, controller: Controller, observation: OutputPort
) -> dict[str, OutputPort]:
    """Adds a controller's policies, a switch between them, and what selects its input.

    Args:
        builder: Where they are added.
        controller: An alternation or an assured controller.
        observation: What the policies observe.

    Returns:
        `actions` (12); under assurance also `expert_acts` (1) and `overrun` (1).

    Raises:
        InputError: if it is another controller, which no system here acts as.
    """
    switch = builder.AddNamedSystem("alternation", PortSwitch(quadruped.N_JOINTS))
    ports: dict[str, InputPortIndex] = {}
    for name, one in controller.policies.items():
        system = builder.AddNamedSystem(name, PolicySystem(one))
        builder.Connect(observation, system.get_observation_input_port())
        port = switch.DeclareInputPort(name)
        builder.Connect(system.get_action_output_port(), port)
        ports[name] = port.get_index()
    # A policy that never acts has no port, and is never chosen.
    only = next(iter(ports.values()))
    expert, student = ports.get("expert", only), ports.get("student", only)
    outputs = {"actions": switch.get_output_port()}
    match controller:
        case AssuredController():
            monitor = AssuranceMonitor(controller.region, controller.hysteresis, expert, student)
            builder.AddNamedSystem("assurance_monitor", monitor)
            builder.Connect(observation, monitor.get_observation_input_port())
            selector = monitor.get_port_selector_output_port()
            outputs["expert_acts"] = monitor.get_expert_acts_output_port()
            outputs["overrun"] = monitor.get_overrun_output_port()
        case AlternatingController():
            schedule = AlternationSchedule(
                controller.period, expert_port=expert, student_port=student
            )
            builder.AddNamedSystem("alternation_schedule", schedule)
            selector = schedule.get_port_selector_output_port()
        case _:
            raise InputError(
                f"a diagram has no system for a controller of type {type(controller).__name__}; "
                "choose a discrete scenario, which the batch simulator plays"
            )
    builder.Connect(selector, switch.get_port_selector_input_port())
    return outputs


def _add_proprioception(
    builder: DiagramBuilder,
    robot: Robot,
    layout: ObservationLayout,
    sensed: Sensed,
    sensor_noise: float,
    machine: RewardMachineSystem,
    hold: ActionHold,
) -> Proprioception:
    proprioception = Proprioception(robot, layout, sensor_noise)
    builder.AddNamedSystem("proprioception", proprioception)
    connect = builder.Connect
    connect(hold.get_held_action_output_port(), proprioception.get_previous_action_input_port())
    connect(machine.get_rm_state_output_port(), proprioception.get_rm_state_input_port())
    connect(machine.get_rm_iterations_output_port(), proprioception.get_rm_iterations_input_port())
    connect(sensed.state, proprioception.get_state_input_port())
    connect(sensed.command, proprioception.get_command_input_port())
    connect(sensed.commanded_dwell, proprioception.get_commanded_dwell_input_port())
    if sensed.joint_noise is not None:
        connect(sensed.joint_noise, proprioception.get_uniform_noise_input_port())
    return proprioception


def _given_observation(
    builder: DiagramBuilder, observation: OutputPort, intervention: Intervention | None
) -> OutputPort:
    """Returns what the policies observe."""
    if intervention is None:
        return observation
    offset = builder.AddNamedSystem("observation_offset", ObservationOffset(intervention))
    builder.Connect(observation, offset.get_observation_input_port())
    return offset.get_given_observation_output_port()
