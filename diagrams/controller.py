"""What stands between a robot's sensors and the action that its joints are to follow."""

from dataclasses import dataclass

from pydrake.systems.framework import DiagramBuilder, InputPortIndex, OutputPort
from pydrake.systems.primitives import Multiplexer, PortSwitch

from glassgait.models.errors import InputError
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.policies.controller import (
    AlternatingController,
    Controller,
    Estimator,
    alone,
    estimator_in_loop,
    expert_of,
)
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.robots.target_limits import TargetLimits
from glassgait.models.task.gait import Gait
from glassgait.models.task.ground import LEVEL_GROUND, Ground
from glassgait.models.task.observation import N_ESTIMATED, ObservationLayout
from glassgait.systems.action_hold import ActionHold
from glassgait.systems.alternation import AlternationSchedule
from glassgait.systems.body_state_sensor import BodyStateSensor
from glassgait.systems.contact_trust import ContactTrustSystem
from glassgait.systems.odometry import OdometrySystem
from glassgait.systems.policy import PolicySystem
from glassgait.systems.proprioception import Proprioception
from glassgait.systems.reward_machine import RewardMachineSystem
from glassgait.systems.state_estimator import StateEstimator
from glassgait.systems.target_limits import TargetLimitsSystem


@dataclass(frozen=True)
class Senses:
    """What a controller needs besides joints and contacts.

    Attributes:
        observes_imu: Whether policies observe gravity's direction and the angular velocity.
        estimator: What estimates the body state; None where the true one is observed.
        limits: What limits the policies' targets; None where nothing does.
    """

    observes_imu: bool = False
    estimator: Estimator | None = None
    limits: TargetLimits | None = None

    @classmethod
    def of(cls, policy: Controller | Policy, *, true_body_state: bool = False) -> "Senses":
        """Returns what a policy needs.

        Args:
            policy: The controller, or the policy that acts alone.
            true_body_state: Whether it is to observe the true body state.

        Raises:
            InputError: if it has no estimator, and the true body state is not asked for.
        """
        estimator = estimator_in_loop(policy, true_body_state=true_body_state)
        return cls(expert_of(policy).layout.imu, estimator, policy.joint_law.limits)

    @property
    def need_imu(self) -> bool:
        """Whether an IMU is needed."""
        return self.observes_imu or isinstance(self.estimator, Odometry) or self.limits is not None


@dataclass(frozen=True)
class Sensed:
    """Where a controller's inputs come from.

    Attributes:
        joints: Measured joint positions, then velocities (24; rad, rad/s).
        command: Forward speed and yaw rate (2; m/s, rad/s).
        commanded_dwell: Commanded iterations in a state (1, control steps).
        touching: Which feet seem to touch at this instant (4).
        imu: The IMU's reading (9), where it is needed.
        state: The plant's state (37), for the true body state where there is no estimator.
        foot_height: True heights of the feet (4, m), for the reward machine where there is no
            estimator.
        ground: What the robot stands on, for its true body state.
    """

    joints: OutputPort
    command: OutputPort
    commanded_dwell: OutputPort
    touching: OutputPort
    imu: OutputPort | None = None
    state: OutputPort | None = None
    foot_height: OutputPort | None = None
    ground: Ground = LEVEL_GROUND


@dataclass(frozen=True)
class ControllerPorts:
    """Parts of a controller that others are connected to.

    Attributes:
        hold: The action hold.
        observation: What is observed (47 + n_states, 53 + n_states with an IMU).
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
    senses: Senses,
    limited: bool,
) -> ControllerPorts:
    """Adds observation, estimator, policies and action hold, and connects the reward machine.

    Args:
        builder: Where they are added.
        robot: The robot.
        gait: The gait that the policy was made for.
        sensed: Where the inputs come from.
        machine: The gait's reward machine.
        policy: The controller.
        senses: What it observes by. An estimator gives the observed body state and the foot heights
            that the reward machine reads.
        limited: Whether joints follow targets within their ranges alone.

    Raises:
        InputError: if a policy was made for another gait or observation.
        ValueError: if an input that is needed is not connected.
    """
    if isinstance(policy, Policy):
        policy = alone(policy)
    layout = ObservationLayout(gait.n_states, imu=senses.observes_imu)
    for one in policy.policies.values() if policy else ():
        one.check(gait=gait, observation_names=layout.names)
    hold = builder.AddNamedSystem("action_hold", ActionHold())
    trust = builder.AddNamedSystem("contact_trust", ContactTrustSystem())
    builder.Connect(sensed.touching, trust.get_touching_input_port())
    builder.Connect(trust.get_believed_contact_output_port(), machine.get_foot_contact_input_port())
    builder.Connect(sensed.commanded_dwell, machine.get_commanded_dwell_input_port())
    proprioception = builder.AddNamedSystem(
        "proprioception", Proprioception(robot, layout, limited=limited)
    )
    _connect_proprioception(builder, proprioception, layout, sensed, machine, hold)
    body_state, sensed_height, expected_height = _add_body_state(
        builder, robot, layout, sensed, senses.estimator, proprioception, trust
    )
    builder.Connect(sensed_height, machine.get_foot_height_input_port())
    builder.Connect(expected_height, trust.get_foot_height_input_port())
    observation = Multiplexer([layout.n_proprioceptive, N_ESTIMATED])
    builder.AddNamedSystem("observation", observation)
    builder.Connect(proprioception.get_proprioception_output_port(), observation.get_input_port(0))
    builder.Connect(body_state, observation.get_input_port(1))
    acting: dict[str, OutputPort] = {}
    if policy is not None:
        acting = AddPolicies(builder, policy, observation.get_output_port())
        if senses.limits is not None:
            acting["actions"] = _limited(
                builder, robot, senses.limits, acting["actions"], sensed, hold
            )
        builder.Connect(acting["actions"], hold.get_action_input_port())
    return ControllerPorts(hold, observation.get_output_port(), acting)


def AddPolicies(  # noqa: N802
    builder: DiagramBuilder, controller: Controller, observation: OutputPort
) -> dict[str, OutputPort]:
    """Adds a controller's policies, a switch between them, and what selects its input.

    Args:
        builder: Where they are added.
        controller: An alternation.
        observation: What the policies observe.

    Returns:
        `actions` (12).

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
    if not isinstance(controller, AlternatingController):
        raise InputError(
            f"a diagram has no system for a controller of type {type(controller).__name__}; "
            "choose a discrete scenario, which the batch simulator plays"
        )
    schedule = AlternationSchedule(controller.period, expert_port=expert, student_port=student)
    builder.AddNamedSystem("alternation_schedule", schedule)
    selector = schedule.get_port_selector_output_port()
    builder.Connect(selector, switch.get_port_selector_input_port())
    return {"actions": switch.get_output_port()}


def _connect_proprioception(
    builder: DiagramBuilder,
    proprioception: Proprioception,
    layout: ObservationLayout,
    sensed: Sensed,
    machine: RewardMachineSystem,
    hold: ActionHold,
) -> None:
    connect = builder.Connect
    connect(hold.get_held_action_output_port(), proprioception.get_previous_action_input_port())
    connect(machine.get_rm_state_output_port(), proprioception.get_rm_state_input_port())
    connect(machine.get_rm_iterations_output_port(), proprioception.get_rm_iterations_input_port())
    connect(sensed.joints, proprioception.get_joints_input_port())
    connect(sensed.command, proprioception.get_command_input_port())
    connect(sensed.commanded_dwell, proprioception.get_commanded_dwell_input_port())
    if layout.imu:
        connect(_needed(sensed.imu, "an IMU"), proprioception.get_imu_input_port())


def _add_body_state(
    builder: DiagramBuilder,
    robot: Robot,
    layout: ObservationLayout,
    sensed: Sensed,
    estimator: Estimator | None,
    proprioception: Proprioception,
    trust: ContactTrustSystem,
) -> tuple[OutputPort, OutputPort, OutputPort]:
    """Adds what estimates the body state, or else senses it.

    Returns:
        The body state (7), the foot heights (4) that the reward machine reads, and those by which a
        foot touches whose sensor is not believed.
    """
    match estimator:
        case None:
            sensor = builder.AddNamedSystem(
                "body_state_sensor", BodyStateSensor(robot, sensed.ground)
            )
            builder.Connect(_needed(sensed.state, "the state"), sensor.get_state_input_port())
            heights = _needed(sensed.foot_height, "true heights of the feet")
            return sensor.get_body_state_output_port(), heights, heights
        case Odometry():
            system = builder.AddNamedSystem("odometry", OdometrySystem(robot, estimator))
            touching = trust.get_believed_touching_output_port()
            builder.Connect(sensed.joints, system.get_joints_input_port())
            builder.Connect(_needed(sensed.imu, "an IMU"), system.get_imu_input_port())
            builder.Connect(touching, system.get_touching_input_port())
            expected = system.get_expected_foot_height_output_port()
        case _:
            system = StateEstimator(estimator, layout.n_proprioceptive)
            builder.AddNamedSystem("state_estimator", system)
            builder.Connect(
                proprioception.get_proprioception_output_port(),
                system.get_proprioception_input_port(),
            )
            expected = system.get_previous_foot_height_output_port()
    heights = system.get_previous_foot_height_output_port()
    return system.get_body_state_output_port(), heights, expected


def _limited(
    builder: DiagramBuilder,
    robot: Robot,
    limits: TargetLimits,
    asked: OutputPort,
    sensed: Sensed,
    hold: ActionHold,
) -> OutputPort:
    """Returns what limits leave of the actions that policies ask for."""
    system = builder.AddNamedSystem("target_limits", TargetLimitsSystem(robot, limits))
    builder.Connect(asked, system.get_action_input_port())
    builder.Connect(hold.get_held_action_output_port(), system.get_previous_action_input_port())
    builder.Connect(sensed.joints, system.get_joints_input_port())
    builder.Connect(_needed(sensed.imu, "an IMU"), system.get_imu_input_port())
    return system.get_limited_action_output_port()


def _needed(port: OutputPort | None, what: str) -> OutputPort:
    if port is None:
        raise ValueError(f"controller: it observes by {what}; connect an output for it")
    return port
