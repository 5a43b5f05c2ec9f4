"""The closed locomotion loop of one robot, as a systems diagram."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from pydrake.common import RandomDistribution
from pydrake.geometry import Meshcat, MeshcatVisualizer, MeshcatVisualizerParams, SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram, DiagramBuilder, InputPortIndex, OutputPort, System
from pydrake.systems.primitives import Multiplexer, PassThrough, PortSwitch, RandomSource

from glassgait.diagrams.commands import AddCommand, AddSeed
from glassgait.diagrams.scenario import NOMINAL_SCENARIO, Scenario, load_scenario
from glassgait.diagrams.station import AddStation, AddWorldState, actuated_joints, ground_reach
from glassgait.models.arrays import Array
from glassgait.models.estimation.sensors import N_IMU, stuck_sensors
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import JointLaw, Robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait, load_gait
from glassgait.models.task.observation import N_ESTIMATED, ObservationLayout
from glassgait.models.task.terrain import Terrain
from glassgait.systems.action import (
    ActionHold,
    AlternationSchedule,
    JointTargets,
    PolicyMemory,
    PolicySystem,
    TargetLimitsSystem,
)
from glassgait.systems.observation import ContactTrustSystem, Proprioception, RewardMachineSystem
from glassgait.systems.reward import FallMonitor, RewardSystem
from glassgait.systems.sensors import (
    BodyStateSensor,
    ContactSensor,
    FootSensor,
    ImuSensor,
    JointSensor,
    ReadingCheck,
    SensorBias,
)

if TYPE_CHECKING:
    from glassgait.models.policies.controller import Controller, Estimator

Ports = dict[str, OutputPort]  # output ports by name

OUTPUTS = (
    *("action", "observation", "reward", "plain_reward", "reward_terms", "failures"),
    *("rm_state", "rm_iterations", "served_dwell", "foot_contact", "foot_height"),
    *("command", "commanded_dwell", "state", "imu"),
)
"""The diagram's outputs; some exist only if they are needed."""

S = TypeVar("S", bound=System)


def MakeLocomotion(  # noqa: N802
    gait: Gait | str | Path,
    scenario: Scenario | str | Path = NOMINAL_SCENARIO,
    *,
    policy: "Controller | Callable[[Array], Array] | None" = None,
    meshcat: Meshcat | None = None,
) -> Diagram:
    """Builds the closed loop of the station, its sensors, the controller and the task.

    .. pydrake_system::

        name: Locomotion
        input_ports: [command, commanded_dwell, action]
        output_ports: [action, observation, reward, plain_reward, reward_terms, failures, rm_state,
          rm_iterations, served_dwell, foot_contact, foot_height, command, commanded_dwell, state,
          imu]

    Inputs: command (2; m/s, rad/s) and commanded_dwell (1, control steps), from a planner, limited
    to the gait's ranges; an unconnected input leaves the scenario's command. action (12), only
    without a policy.
    Outputs: action (12), within limits. observation (n); with an IMU n is 53 + n_states, also for a
    function as the policy and without a policy. reward and plain_reward (1) of the step that ends
    now, reward_terms (12). failures (7). rm_state (n_states, one-hot), rm_iterations, served_dwell
    (1, control steps). foot_contact, foot_height (4; {0, 1}, m). state (37), the plant's. imu (9),
    only if it is needed.

    Read the outputs at a control instant before its updates, as `Simulator.AdvanceTo` leaves them.
    In a default context the robot stands at rest; `SetRandomContext` draws the sensors' errors and
    commands. The caller applies pushes with `glassgait.diagrams.rollout.push`.

    Args:
        gait, scenario: A `Gait` and a `Scenario`, or the name or path of a file of each.
        policy: A policy, a `Controller` of two in alternation, or a function from the observation
            (..., n) to an action (..., 12); see `FunctionPolicy`.
    """
    # Imported here, since programs that use other parts of this module need no policies.
    from glassgait.models.estimation.odometry import Odometry  # noqa: PLC0415
    from glassgait.models.policies.controller import (  # noqa: PLC0415
        controller_of,
        estimator_in_loop,
    )

    gait = gait if isinstance(gait, Gait) else load_gait(gait)
    scenario = scenario if isinstance(scenario, Scenario) else load_scenario(scenario)
    builder = DiagramBuilder()
    add = partial(_add, builder)
    controller = controller_of(_outside if policy is None else policy, gait, scenario.robot_of())
    estimator = estimator_in_loop(controller, true_body_state=scenario.true_body_state)
    robot, law = scenario.robot_of(controller), scenario.joint_law(controller)
    layout = ObservationLayout(gait.n_states, imu=controller.expert.layout.imu)

    # Systems draw random numbers in the order in which they are added. Commands and sensor errors
    # come first, so that a seed gives the same ones whatever systems follow.
    ports = AddCommand(builder, gait, scenario.command, meshcat)
    needs_imu = layout.imu or isinstance(estimator, Odometry) or law.limits is not None
    errors = _add_sensor_errors(builder, scenario, imu=needs_imu)

    # The robot on its ground with its sensors.
    station = scenario.station.with_gains(robot, law)
    reach = ground_reach(station.terrain)
    plant, scene_graph, instance = AddStation(builder, robot, station, reach=reach)
    ports["state"] = AddWorldState(builder, plant, station)
    ports |= _add_sensors(builder, robot, scenario, ports["state"], errors, imu=needs_imu)

    # The controller, and the joints that follow its delayed actions.
    hold = add("action_hold", ActionHold(scenario.latency, station.time_step))
    ports |= _outputs(hold)
    ports |= _add_observation(
        builder, robot, scenario, gait, layout, estimator, ports, limited=law.limited
    )
    acting = controller if policy is not None else None
    ports["action"] = _add_action(builder, robot, law, acting, gait, layout, hold, ports)
    targets = JointTargets(robot, actuated_joints(plant), limited=law.limited)
    add("joint_targets", targets, action=ports["delayed_action"])
    builder.Connect(targets.get_output_port(), plant.get_desired_state_input_port(instance))

    # Reward, failures and display.
    ports |= _add_task(builder, robot, scenario, law, ports)
    if meshcat is not None:
        _add_display(builder, robot, gait, station.terrain, meshcat, plant, scene_graph, ports)
    for name in OUTPUTS:
        if name in ports:
            builder.ExportOutput(ports[name], name)
    diagram = builder.Build()
    diagram.set_name("Locomotion")
    return diagram


def _outside(observation: Array) -> Array:
    raise NotImplementedError  # Placeholder for a policy outside the diagram.


def _add(builder: DiagramBuilder, name: str, system: S, **inputs: OutputPort | None) -> S:
    """Adds a system and connects its inputs by name, except those that are None."""
    builder.AddNamedSystem(name, system)
    for port, source in inputs.items():
        if source is not None:
            builder.Connect(source, system.GetInputPort(port))
    return system


def _outputs(system: System) -> Ports:
    ports = (system.get_output_port(index) for index in range(system.num_output_ports()))
    return {port.get_name(): port for port in ports}


def _add_sensor_errors(builder: DiagramBuilder, scenario: Scenario, *, imu: bool) -> Ports:
    """Adds the error sources of joint, contact and IMU sensors."""
    errors: Ports = {}
    for name, share, size in (
        ("sensor_noise", scenario.sensor_noise, 2 * quadruped.N_JOINTS),
        ("contact_noise", scenario.contact_flips, quadruped.N_LEGS),
        ("imu_noise", scenario.sensor_noise if imu else 0.0, N_IMU),
    ):
        if share > 0.0:
            noise = RandomSource(RandomDistribution.kUniform, size, CONTROL_PERIOD)
            errors[name] = builder.AddNamedSystem(name, noise).get_output_port()
    if scenario.encoder_bias > 0.0 or (imu and scenario.imu.half_widths.any()):
        bias = SensorBias(scenario.randomization())
        _add(builder, "sensor_bias", bias, seed=AddSeed(builder, "sensor_bias_seed"))
        errors |= _outputs(bias)
    return errors


def _add_sensors(
    builder: DiagramBuilder,
    robot: Robot,
    scenario: Scenario,
    state: OutputPort,
    errors: Ports,
    *,
    imu: bool,
) -> Ports:
    """Adds the sensors of joints, feet and trunk; returns their outputs."""
    add = partial(_add, builder)
    joints = JointSensor(scenario.sensor_noise)
    noise, bias = errors.get("sensor_noise"), errors.get("encoder_bias")
    add("joint_sensor", joints, state=state, uniform_noise=noise, encoder_bias=bias)
    feet = add("foot_sensor", FootSensor(robot, scenario.station.ground), state=state)
    ports = _outputs(joints) | _outputs(feet)

    # Replace the true contacts if contact sensors flip or are stuck.
    stuck = stuck_sensors(scenario.stuck_open, scenario.stuck_closed)
    if "contact_noise" in errors or stuck.any():
        contacts = ContactSensor(scenario.contact_flips, stuck)
        noise = errors.get("contact_noise")
        add("contact_sensors", contacts, touching=ports["touching"], uniform_noise=noise)
        ports["touching"] = contacts.get_output_port()

    if imu:
        gravity = scenario.station.terrain.gravity
        sensor = ImuSensor(gravity, scenario.imu.delay, scenario.sensor_noise)
        noise, bias = errors.get("imu_noise"), errors.get("imu_bias")
        add("imu", sensor, state=state, uniform_noise=noise, imu_bias=bias)
        ports |= _outputs(sensor)
    sensed = {name: ports.get(name) for name in ("joints", "touching", "imu")}
    return ports | _outputs(add("reading_check", ReadingCheck(), **sensed))


def _add_observation(
    builder: DiagramBuilder,
    robot: Robot,
    scenario: Scenario,
    gait: Gait,
    layout: ObservationLayout,
    estimator: "Estimator | None",
    ports: Ports,
    *,
    limited: bool,
) -> Ports:
    """Adds contacts, machine and estimator; returns the observation and the machine's outputs."""
    add = partial(_add, builder)

    # Contacts, the reward machine, and the part of the observation without estimates.
    trust = add("contact_trust", ContactTrustSystem(), touching=ports["sound_touching"])
    machine = RewardMachineSystem(gait)
    believed, dwell = trust.GetOutputPort("believed_contact"), ports["commanded_dwell"]
    add("reward_machine", machine, foot_contact=believed, commanded_dwell=dwell)
    proprioception = add(
        "proprioception",
        Proprioception(robot, layout, limited=limited),
        joints=ports["sound_joints"],
        command=ports["command"],
        commanded_dwell=dwell,
        previous_action=ports["held_action"],
        rm_state=machine.GetOutputPort("rm_state"),
        rm_iterations=machine.GetOutputPort("rm_iterations"),
        **({"imu": ports["sound_imu"]} if layout.imu else {}),
    )

    # The body state, and the foot heights that contacts and the machine read. Imported here, since
    # only estimates of the body state need them.
    from glassgait.models.estimation.odometry import Odometry  # noqa: PLC0415
    from glassgait.systems.estimation import OdometrySystem, StateEstimator  # noqa: PLC0415

    expected = None
    match estimator:
        case None:
            ground = scenario.station.ground
            body = add("body_state_sensor", BodyStateSensor(robot, ground), state=ports["state"])
            height = ports["foot_height"]
        case Odometry():
            body = add(
                "odometry",
                OdometrySystem(robot, estimator),
                joints=ports["sound_joints"],
                imu=ports["sound_imu"],
                touching=trust.GetOutputPort("believed_touching"),
            )
            height = body.GetOutputPort("previous_foot_height")
            expected = body.GetOutputPort("expected_foot_height")
        case network:
            learned = StateEstimator(network, layout.n_proprioceptive)
            body = add("state_estimator", learned, proprioception=proprioception.get_output_port())
            height = body.GetOutputPort("previous_foot_height")
    builder.Connect(height, machine.GetInputPort("foot_height"))
    builder.Connect(expected or height, trust.GetInputPort("foot_height"))

    # The whole observation.
    observation = Multiplexer([layout.n_proprioceptive, N_ESTIMATED])
    builder.AddNamedSystem("observation", observation)
    builder.Connect(proprioception.get_output_port(), observation.get_input_port(0))
    builder.Connect(body.GetOutputPort("body_state"), observation.get_input_port(1))
    return _outputs(machine) | {"observation": observation.get_output_port()}


def _add_action(
    builder: DiagramBuilder,
    robot: Robot,
    law: JointLaw,
    controller: "Controller | None",
    gait: Gait,
    layout: ObservationLayout,
    hold: ActionHold,
    ports: Ports,
) -> OutputPort:
    """Adds the policies or an input for actions, and the limits; returns the limited action."""
    if controller is None:
        outside = builder.AddNamedSystem("outside_action", PassThrough(quadruped.N_JOINTS))
        builder.ExportInput(outside.get_input_port(), "action")
        asked = outside.get_output_port()
    else:
        asked = _add_policies(builder, controller, gait, layout, ports["observation"])
    limits = TargetLimitsSystem(robot, law.limits)
    sensed = ("joints", "imu") if law.limits else ()
    inputs, before = {name: ports[f"sound_{name}"] for name in sensed}, ports["held_action"]
    _add(builder, "target_limits", limits, action=asked, previous_action=before, **inputs)
    builder.Connect(asked, hold.GetInputPort("asked_action"))
    builder.Connect(limits.get_output_port(), hold.GetInputPort("action"))
    return limits.get_output_port()


def _add_policies(
    builder: DiagramBuilder,
    controller: "Controller",
    gait: Gait,
    layout: ObservationLayout,
    observation: OutputPort,
) -> OutputPort:
    """Adds policies and a switch between them; returns their action."""
    # Drake's switch evaluates only the selected policy.
    switch = builder.AddNamedSystem("alternation", PortSwitch(quadruped.N_JOINTS))
    indices: dict[str, InputPortIndex] = {}
    for name, policy in controller.policies.items():
        policy.check(gait=gait, observation_names=layout.names)
        acting, seen = PolicySystem(policy), observation
        if policy.remembers:
            memory = _add(builder, f"{name}_memory", PolicyMemory(policy), observation=observation)
            seen = memory.get_output_port()
        _add(builder, name, acting, observation=seen)
        port = switch.DeclareInputPort(name)
        builder.Connect(acting.get_output_port(), port)
        indices[name] = port.get_index()
    # A policy that never acts has no port and is never selected.
    only = next(iter(indices.values()))
    schedule = AlternationSchedule(
        controller.period, indices.get("expert", only), indices.get("student", only)
    )
    builder.AddNamedSystem("alternation_schedule", schedule)
    builder.Connect(schedule.get_output_port(), switch.get_port_selector_input_port())
    return switch.get_output_port()


def _add_task(
    builder: DiagramBuilder, robot: Robot, scenario: Scenario, law: JointLaw, ports: Ports
) -> Ports:
    """Adds the reward and the fall monitor; returns their outputs."""
    moved = {
        "state": ports["state"],
        "action": ports["held_action"],
        "previous_action": ports["previous_action"],
    }
    shared = ("command", "foot_contact", "foot_height", "reward_multiplier")
    reward = RewardSystem(robot, scenario.weights, law)
    _add(builder, "reward", reward, **moved, **{name: ports[name] for name in shared})
    monitor = FallMonitor(robot, scenario.limits, scenario.station.ground)
    _add(builder, "fall_monitor", monitor, **moved, is_sound=ports["is_sound"])
    return _outputs(reward) | _outputs(monitor)


def _add_display(
    builder: DiagramBuilder,
    robot: Robot,
    gait: Gait,
    terrain: Terrain,
    meshcat: Meshcat,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    ports: Ports,
) -> None:
    """Shows the robot, ground, contacts and RM state in Meshcat."""
    # Imported here, since most diagrams have no display.
    from glassgait.diagrams.visualization import draw_ground  # noqa: PLC0415
    from glassgait.systems.gait_display import DISPLAY_PERIOD, GaitDisplay  # noqa: PLC0415

    draw_ground(meshcat, terrain)
    meshcat.SetCameraPose([0.75, -1.05, 0.55], [0.0, 0.0, 0.18])
    params = MeshcatVisualizerParams(publish_period=DISPLAY_PERIOD)
    MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat, params)
    _add(
        builder,
        "gait_display",
        GaitDisplay(robot, gait, meshcat),
        # The plant's state is within the modelled ground.
        state=plant.get_state_output_port(),
        rm_state=ports["rm_state"],
        foot_contact=ports["foot_contact"],
    )
