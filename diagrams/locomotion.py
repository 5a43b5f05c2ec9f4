"""The closed locomotion loop of one robot, as a systems diagram."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge
from pydrake.common import RandomDistribution
from pydrake.geometry import Meshcat
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, OutputPort
from pydrake.systems.primitives import (
    ConstantVectorSource,
    LinearSystem,
    Multiplexer,
    PortSwitch,
    RandomSource,
)

from glassgait.diagrams.station import AddA1Station, StationConfig, actuated_joints
from glassgait.diagrams.visualization import AddLocomotionDisplay
from glassgait.models.a1 import kinematics, robot
from glassgait.models.a1.robot import Array
from glassgait.models.errors import InputError, shown
from glassgait.models.policies.policy import Policy
from glassgait.models.settings import Interval, Settings
from glassgait.models.task import COMMAND_STEPS, CONTROL_PERIOD
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import N_ESTIMATED, ObservationLayout
from glassgait.models.task.reward import RewardWeights
from glassgait.models.task.termination import TerminationLimits
from glassgait.systems.action_hold import ActionHold
from glassgait.systems.alternation import AlternationSchedule
from glassgait.systems.body_state_sensor import BodyStateSensor
from glassgait.systems.command import RandomCommand
from glassgait.systems.fall_monitor import FallMonitor
from glassgait.systems.foot_sensor import FootSensor
from glassgait.systems.joint_targets import JointTargets
from glassgait.systems.meshcat_command import MeshcatCommand
from glassgait.systems.policy import PolicySystem
from glassgait.systems.proprioception import Proprioception
from glassgait.systems.reward import RewardSystem
from glassgait.systems.reward_machine import RewardMachineSystem
from glassgait.systems.state_estimator import StateEstimator


@dataclass(frozen=True)
class FixedCommand(Settings):
    """One command for the whole rollout.

    Attributes:
        speed: Forward speed (m/s).
        yaw_rate: Yaw rate (rad/s).
        dwell: Iterations to stay in a state of the reward machine (control steps).
    """

    title: ClassVar[str] = "command"

    speed: float = 0.5
    yaw_rate: float = 0.0
    dwell: Annotated[int, Ge(1)] = 8

    def check(self, gait: Gait) -> None:
        """Checks that a gait is made for the command.

        Raises:
            InputError: if a value is beyond the gait's range.
        """
        ranges = {
            "speed": (-gait.max_speed, gait.max_speed),
            "yaw_rate": (-gait.max_yaw_rate, gait.max_yaw_rate),
            "dwell": gait.dwell,
        }
        for name, (least, greatest) in ranges.items():
            value = getattr(self, name)
            if not least <= value <= greatest:
                raise InputError(
                    f"{self.title}: {name} is {shown(value)}; give {least:g} to {greatest:g}, the "
                    f"range of gait {gait.name!r}"
                )


@dataclass(frozen=True)
class DrawnCommands(Settings):
    """Commands drawn over the gait's range, a new one every 10 s.

    Attributes:
        speed_range: Least and greatest forward speed (m/s); the gait's by default.
    """

    title: ClassVar[str] = "command"

    speed_range: Interval | None = None


@dataclass(frozen=True)
class SliderCommand:
    """Commands from sliders in Meshcat."""


@dataclass(frozen=True)
class LocomotionConfig(Settings):
    """How the loop is closed.

    Attributes:
        station: Physics.
        command: Where commands come from.
        alternation_period: Control steps from one action of the expert to the next; 1 is the expert
            alone, 0 the student alone.
        sensor_noise: Factor on the noise of the joints' sensors; 0 for none, 1 for the task's.
        weights: Weights of the reward.
        limits: Bounds that the fall monitor watches.
    """

    title: ClassVar[str] = "locomotion"

    station: StationConfig = field(default_factory=StationConfig)
    command: FixedCommand | DrawnCommands | SliderCommand = field(default_factory=FixedCommand)
    alternation_period: Annotated[int, Ge(0)] = 1
    sensor_noise: Annotated[float, Ge(0)] = 0.0
    weights: RewardWeights = field(default_factory=RewardWeights)
    limits: TerminationLimits = field(default_factory=TerminationLimits)


def MakeLocomotion(  # noqa: N802
    gait: Gait,
    config: LocomotionConfig,
    *,
    expert: Policy | None = None,
    student: Policy | None = None,
    estimator: Callable[[Array], Array] | None = None,
    meshcat: Meshcat | None = None,
) -> Diagram:
    """Builds the station with the task and the policies around it.

    .. pydrake_system::

        name: Locomotion
        input_ports:
        - actions
        output_ports:
        - actions
        - observations
        - reward
        - plain_reward
        - reward_terms
        - rm_state
        - rm_iterations
        - served_dwell
        - foot_contact
        - foot_height
        - failures
        - command
        - commanded_dwell
        - state

    Inputs: actions (12), only where neither expert nor student is given.
    Outputs: actions (12), what acts at this control step. observations (47 + n_states). reward (1)
    and plain_reward (1) of the step that ends now, reward_terms (9). rm_state (n_states, one-hot),
    rm_iterations (1), served_dwell (1, control steps). foot_contact (4), foot_height (4, m).
    failures (6). command (2; m/s, rad/s), commanded_dwell (1, control steps). state (37), the
    plant's.

    Read the outputs at a control instant before its updates, as `Simulator.AdvanceTo` leaves them.
    In a default context the robot stands at rest. `SetRandomContext` draws the robot's pose, the
    sensors' noise and drawn commands.

    Args:
        gait: The gait whose reward machine runs.
        config: How the loop is closed.
        expert: The policy that acts every n-th step.
        student: The policy that acts otherwise.
        estimator: Maps proprioception to the body state; the true values by default.
        meshcat: Shows robot, contacts and machine state there.

    Raises:
        InputError: if a policy was made for another gait or observation, the gait is not made for
            the command, or the plant's step does not divide the control period.
        ValueError: if the alternation asks for a policy that is not given.
    """
    layout = ObservationLayout(gait.n_states)
    for policy in (expert, student):
        if policy is not None:
            policy.check(gait=gait.name, observation_names=layout.names)

    if isinstance(config.command, FixedCommand):
        config.command.check(gait)
    if config.station.time_step > 0:
        # Otherwise the plant and the controller would drift apart.
        config.station.plant_steps()

    builder = DiagramBuilder()
    # What comes first draws first in a random context: a seed gives the same commands with noise
    # and without, and the same noise whatever the robot's pose is drawn from.
    command, commanded_dwell = _add_command(builder, gait, config, meshcat)
    noise = _add_noise(builder) if config.sensor_noise > 0 else None
    # The plant stands in this diagram itself: the error-controlled contact integrator looks for it
    # there.
    plant, scene_graph, instance = AddA1Station(builder, config.station)
    state = plant.get_state_output_port()

    foot_sensor, machine = _add_machine(builder, gait, state, commanded_dwell)
    hold = builder.AddNamedSystem("action_hold", ActionHold())
    proprioception = _add_proprioception(builder, layout, config, machine, hold)
    if noise is not None:
        builder.Connect(noise, proprioception.get_uniform_noise_input_port())
    builder.Connect(state, proprioception.get_state_input_port())
    builder.Connect(command, proprioception.get_command_input_port())
    builder.Connect(commanded_dwell, proprioception.get_commanded_dwell_input_port())
    observation = _add_observation(builder, layout, proprioception, state, estimator)
    if expert is None and student is None:
        builder.ExportInput(hold.get_action_input_port(), "actions")
    else:
        action = _add_policies(builder, observation, config.alternation_period, expert, student)
        builder.Connect(action, hold.get_action_input_port())
        builder.ExportOutput(action, "actions")
    targets = builder.AddNamedSystem("joint_targets", JointTargets(actuated_joints(plant)))
    desired_state = plant.get_desired_state_input_port(instance)
    builder.Connect(hold.get_held_action_output_port(), targets.get_action_input_port())
    builder.Connect(targets.get_desired_state_output_port(), desired_state)
    judged = _add_judges(builder, config, state, command, foot_sensor, machine, hold)
    if meshcat is not None:
        AddLocomotionDisplay(
            builder, plant, scene_graph, gait, foot_sensor, machine, meshcat=meshcat
        )

    exported = {
        "observations": observation,
        **judged,
        "rm_state": machine.get_rm_state_output_port(),
        "rm_iterations": machine.get_rm_iterations_output_port(),
        "served_dwell": machine.get_served_dwell_output_port(),
        "foot_contact": foot_sensor.get_foot_contact_output_port(),
        "foot_height": foot_sensor.get_foot_height_output_port(),
        "command": command,
        "commanded_dwell": commanded_dwell,
        "state": state,
    }
    for name, port in exported.items():
        builder.ExportOutput(port, name)
    diagram = builder.Build()
    diagram.set_name("Locomotion")
    return diagram


def find_locomotion(diagram: Diagram) -> Diagram:
    """Finds what `MakeLocomotion` built: the diagram itself, or a part of it at any depth.

    Raises:
        InputError: if there is none, or more than one.
    """
    found = list(_locomotions(diagram))
    if len(found) != 1:
        raise InputError(
            f"locomotion: diagram {diagram.get_name()!r} holds {len(found)} of what MakeLocomotion "
            "builds; give one that holds exactly one"
        )
    return found[0]


def set_plant_state(diagram: Diagram, context: Context, state: Array | None = None) -> None:
    """Puts the robot into a state.

    Args:
        diagram: What `MakeLocomotion` built, or a larger diagram that holds it.
        context: Its own context, or the root context that its context is part of; to be changed.
        state: The plant's state x (37); standing at rest by default.

    Raises:
        InputError: if the context is of another diagram.
    """
    if state is None:
        state = kinematics.standing_state(robot.DEFAULT_STANCE)
    plant, plant_context = _find_plant(diagram, context)
    plant.SetPositionsAndVelocities(plant_context, state)


def push(diagram: Diagram, context: Context, velocity: Array) -> None:
    """Adds to the velocity of the robot's trunk.

    Args:
        diagram: What `MakeLocomotion` built, or a larger diagram that holds it.
        context: Its own context, or the root context that its context is part of; to be changed.
        velocity: What is added (3; m/s, world frame).

    Raises:
        InputError: if the context is of another diagram.
    """
    plant, plant_context = _find_plant(diagram, context)
    state = plant.GetPositionsAndVelocities(plant_context)
    state[robot.LINEAR_VELOCITY] += velocity
    plant.SetPositionsAndVelocities(plant_context, state)


def normalize_attitude(diagram: Diagram, context: Context) -> None:
    """Gives the quaternion of the robot's trunk the length 1 again.

    A discrete plant adds rates to it, step by step, and within a minute it is a tenth too long: by
    that feet seem higher than they are, since the task takes it for a unit quaternion.

    Args:
        diagram: What `MakeLocomotion` built, or a larger diagram that holds it.
        context: Its own context, or the root context that its context is part of; to be changed.

    Raises:
        InputError: if the context is of another diagram.
    """
    plant, plant_context = _find_plant(diagram, context)
    state = plant.GetPositionsAndVelocities(plant_context)
    state[robot.QUATERNION] /= np.linalg.norm(state[robot.QUATERNION])
    plant.SetPositionsAndVelocities(plant_context, state)


def _find_plant(diagram: Diagram, context: Context) -> tuple[MultibodyPlant, Context]:
    """Finds the robot's plant and its part of the diagram's own context, or of the root's."""
    plant = find_locomotion(diagram).GetSubsystemByName("plant")
    assert isinstance(plant, MultibodyPlant)
    try:
        diagram.ValidateContext(context)
        return plant, diagram.GetMutableSubsystemContext(plant, context)
    except RuntimeError:
        pass
    try:
        return plant, plant.GetMyMutableContextFromRoot(context)
    except RuntimeError as error:
        raise InputError(
            f"locomotion: the context is not of diagram {diagram.get_name()!r}; give its own "
            "context, or the root's"
        ) from error


def _locomotions(diagram: Diagram) -> Iterator[Diagram]:
    # A larger diagram may give it another name; its fall monitor is always there.
    name = "fall_monitor"
    if diagram.HasSubsystemNamed(name) and isinstance(
        diagram.GetSubsystemByName(name), FallMonitor
    ):
        yield diagram
    for system in diagram.GetSystems():
        if isinstance(system, Diagram):
            yield from _locomotions(system)


def _add_noise(builder: DiagramBuilder) -> OutputPort:
    noise = RandomSource(RandomDistribution.kUniform, 2 * robot.N_JOINTS, CONTROL_PERIOD)
    return builder.AddNamedSystem("sensor_noise", noise).get_output_port()


def _add_command(
    builder: DiagramBuilder, gait: Gait, config: LocomotionConfig, meshcat: Meshcat | None
) -> tuple[OutputPort, OutputPort]:
    match config.command:
        case FixedCommand(speed=speed, yaw_rate=yaw_rate, dwell=dwell):
            velocity = ConstantVectorSource([speed, yaw_rate])
            builder.AddNamedSystem("command", velocity)
            rhythm = builder.AddNamedSystem("commanded_dwell", ConstantVectorSource([dwell]))
            return velocity.get_output_port(), rhythm.get_output_port()
        case DrawnCommands(speed_range=speed_range):
            source = _add_random_command(builder, gait, speed_range)
            return source.get_command_output_port(), source.get_commanded_dwell_output_port()
        case SliderCommand():
            if meshcat is None:
                raise ValueError("locomotion: commands from sliders need a Meshcat")
            source = MeshcatCommand(gait, meshcat)
    builder.AddNamedSystem("command", source)
    return source.get_command_output_port(), source.get_commanded_dwell_output_port()


def _add_random_command(
    builder: DiagramBuilder, gait: Gait, speed_range: tuple[float, float] | None
) -> RandomCommand:
    # A system written in Python cannot draw its own parameters in `SetRandomContext`, but a linear
    # system draws its initial state. One that stays where it starts gives a seed that holds for the
    # whole rollout; a RandomSource would draw another one in the first update.
    nothing = np.zeros((1, 0))
    seed = LinearSystem(np.eye(1), nothing, np.eye(1), nothing, COMMAND_STEPS * CONTROL_PERIOD)
    seed.configure_random_state(np.eye(1))
    source = RandomCommand(gait, speed_range)
    builder.AddNamedSystem("command_seed", seed)
    builder.AddNamedSystem("command", source)
    builder.Connect(seed.get_output_port(), source.get_seed_input_port())
    return source


def _add_machine(
    builder: DiagramBuilder, gait: Gait, state: OutputPort, commanded_dwell: OutputPort
) -> tuple[FootSensor, RewardMachineSystem]:
    foot_sensor = builder.AddNamedSystem("foot_sensor", FootSensor())
    machine = builder.AddNamedSystem("reward_machine", RewardMachineSystem(gait))
    connect = builder.Connect
    connect(state, foot_sensor.get_state_input_port())
    connect(foot_sensor.get_foot_contact_output_port(), machine.get_foot_contact_input_port())
    connect(foot_sensor.get_foot_height_output_port(), machine.get_foot_height_input_port())
    connect(commanded_dwell, machine.get_commanded_dwell_input_port())
    return foot_sensor, machine


def _add_proprioception(
    builder: DiagramBuilder,
    layout: ObservationLayout,
    config: LocomotionConfig,
    machine: RewardMachineSystem,
    hold: ActionHold,
) -> Proprioception:
    proprioception = builder.AddNamedSystem(
        "proprioception", Proprioception(layout, config.sensor_noise)
    )
    connect = builder.Connect
    connect(hold.get_held_action_output_port(), proprioception.get_previous_action_input_port())
    connect(machine.get_rm_state_output_port(), proprioception.get_rm_state_input_port())
    connect(machine.get_rm_iterations_output_port(), proprioception.get_rm_iterations_input_port())
    return proprioception


def _add_judges(
    builder: DiagramBuilder,
    config: LocomotionConfig,
    state: OutputPort,
    command: OutputPort,
    foot_sensor: FootSensor,
    machine: RewardMachineSystem,
    hold: ActionHold,
) -> dict[str, OutputPort]:
    reward = builder.AddNamedSystem("reward", RewardSystem(config.weights))
    monitor = builder.AddNamedSystem("fall_monitor", FallMonitor(config.limits))
    connect = builder.Connect
    for system in (reward, monitor):
        connect(state, system.get_state_input_port())
        connect(hold.get_held_action_output_port(), system.get_action_input_port())
        connect(hold.get_previous_action_output_port(), system.get_previous_action_input_port())
    connect(command, reward.get_command_input_port())
    connect(foot_sensor.get_foot_contact_output_port(), reward.get_foot_contact_input_port())
    connect(machine.get_reward_multiplier_output_port(), reward.get_reward_multiplier_input_port())
    return {
        "reward": reward.get_reward_output_port(),
        "plain_reward": reward.get_plain_reward_output_port(),
        "reward_terms": reward.get_reward_terms_output_port(),
        "failures": monitor.get_failures_output_port(),
    }


def _add_observation(
    builder: DiagramBuilder,
    layout: ObservationLayout,
    sensor: Proprioception,
    state: OutputPort,
    estimator: Callable[[Array], Array] | None,
) -> OutputPort:
    proprioception = sensor.get_proprioception_output_port()
    if estimator is None:
        body_state = builder.AddNamedSystem("body_state_sensor", BodyStateSensor())
        builder.Connect(state, body_state.get_state_input_port())
    else:
        body_state = StateEstimator(estimator, layout.n_proprioceptive)
        builder.AddNamedSystem("state_estimator", body_state)
        builder.Connect(proprioception, body_state.get_proprioception_input_port())
    observation = Multiplexer([layout.n_proprioceptive, N_ESTIMATED])
    builder.AddNamedSystem("observation", observation)
    builder.Connect(proprioception, observation.get_input_port(0))
    builder.Connect(body_state.get_body_state_output_port(), observation.get_input_port(1))
    return observation.get_output_port()


def _add_policies(
    builder: DiagramBuilder,
    observation: OutputPort,
    period: int,
    expert: Policy | None,
    student: Policy | None,
) -> OutputPort:
    if expert is None and period != 0:
        raise ValueError(f"locomotion: alternation period {period} needs an expert; give one")
    if student is None and period != 1:
        raise ValueError(f"locomotion: alternation period {period} needs a student; give one")
    switch = builder.AddNamedSystem("alternation", PortSwitch(robot.N_JOINTS))
    ports = {}
    for name, policy in (("expert", expert), ("student", student)):
        if policy is not None:
            system = builder.AddNamedSystem(name, PolicySystem(policy))
            builder.Connect(observation, system.get_observation_input_port())
            ports[name] = switch.DeclareInputPort(name)
            builder.Connect(system.get_action_output_port(), ports[name])
    first = next(iter(ports.values())).get_index()
    schedule = AlternationSchedule(
        period,
        expert_port=ports["expert"].get_index() if expert else first,
        student_port=ports["student"].get_index() if student else first,
    )
    builder.AddNamedSystem("alternation_schedule", schedule)
    builder.Connect(schedule.get_port_selector_output_port(), switch.get_port_selector_input_port())
    return switch.get_output_port()
