"""The closed locomotion loop of one robot, as a systems diagram."""

from pydrake.common import RandomDistribution
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort
from pydrake.systems.primitives import RandomSource

from glassgait.diagrams.commands import AddCommand, AddGivenCommand
from glassgait.diagrams.controller import AddController, Sensed
from glassgait.diagrams.gait_machine import AddGaitMachine
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.station import AddStation, actuated_joints
from glassgait.diagrams.visualization import AddLocomotionDisplay
from glassgait.models.counterfactuals.question import Intervention
from glassgait.models.policies.controller import Controller
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.systems.action_delay import ActionDelay
from glassgait.systems.action_hold import ActionHold
from glassgait.systems.contact_noise import ContactNoise
from glassgait.systems.fall_monitor import FallMonitor
from glassgait.systems.foot_sensor import FootSensor
from glassgait.systems.joint_targets import JointTargets
from glassgait.systems.reward import RewardSystem
from glassgait.systems.reward_machine import RewardMachineSystem


def MakeLocomotion(  # noqa: N802
    gait: Gait | GaitSwitch,
    scenario: Scenario | None = None,
    *,
    policy: Controller | Policy | None = None,
    meshcat: Meshcat | None = None,
    intervention: Intervention | None = None,
) -> Diagram:
    """Builds the station with the task and the policies around it.

    .. pydrake_system::

        name: Locomotion
        input_ports:
        - command
        - commanded_dwell
        - actions
        - requested_gait
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
        - expert_acts
        - overrun

    Inputs: command (2; m/s, rad/s) and commanded_dwell (1, control steps), from a planner, limited
    to what the gait is made for; each may stay unconnected, and then the scenario's command holds.
    actions (12), only where no policy is given. requested_gait (1), only of several gaits
    without buttons; see `GaitSwitchSystem`.
    Outputs: actions (12), what acts at this control step. observations (47 + n_states). reward (1)
    and plain_reward (1) of the step that ends now, reward_terms (12). rm_state (n_states, one-hot),
    rm_iterations (1), served_dwell (1, control steps). foot_contact (4), foot_height (4, m).
    failures (6). command (2) and commanded_dwell (1), by which the robot goes. state (37), the
    plant's. Of a policy under assurance alone, expert_acts (1) and overrun (1); see
    `AssuranceMonitor`.

    Read the outputs at a control instant before its updates, as `Simulator.AdvanceTo` leaves them.
    In a default context the robot stands at rest. `SetRandomContext` draws the robot's pose, the
    sensors' noise and drawn commands. The scenario's pushes come between two control steps, from
    whoever advances the simulator; see `glassgait.diagrams.plant_state.push`.

    Args:
        gait: The gait whose reward machine runs, or several that change on request.
        scenario: The world, and how the loop is closed; the training world by default.
        policy: The controller. Its estimator gives the observed body state and the foot heights
            that the reward machine reads; they are the true ones where the scenario says so, and
            where no policy is given.
        meshcat: Shows robot, contacts and machine state there.
        intervention: Gives the policy another observation for some control steps; the outputs are
            the robot's own.

    Raises:
        InputError: if a policy was made for another gait or observation, or has no estimator, and
            the scenario does not ask for the true body state; or the gait is not made for the
            command.
        ValueError: if commands come from sliders, and there is no Meshcat.
    """
    scenario, gaits = scenario or Scenario(), gait
    robot = scenario.robot_of(policy)
    gait = gaits.gait if isinstance(gaits, GaitSwitch) else gaits
    builder = DiagramBuilder()
    # What comes first draws first in a random context: a seed gives the same commands with noise
    # and without, and the same noise whatever the robot's pose is drawn from.
    drawn = AddCommand(builder, gait, scenario.command, meshcat)
    command, commanded_dwell = AddGivenCommand(builder, gait, drawn)
    joint_noise = AddNoise(builder, "sensor_noise", scenario.sensor_noise, 2 * quadruped.N_JOINTS)
    contact_noise = AddNoise(builder, "contact_noise", scenario.contact_flips, quadruped.N_LEGS)
    # The plant stands in this diagram itself: the error-controlled contact integrator looks for it
    # there.
    plant, scene_graph, instance = AddStation(builder, robot, scenario.station)
    state = plant.get_state_output_port()

    foot_sensor = builder.AddNamedSystem("foot_sensor", FootSensor(robot))
    builder.Connect(state, foot_sensor.get_state_input_port())
    sensed = Sensed(
        state=state,
        foot_contact=_sensed_contact(builder, scenario, foot_sensor, contact_noise),
        command=command,
        commanded_dwell=commanded_dwell,
        foot_height=foot_sensor.get_foot_height_output_port(),
        joint_noise=joint_noise,
    )
    machine = AddGaitMachine(builder, gaits, scenario.command, meshcat)
    controller = AddController(
        builder,
        robot,
        gait,
        sensed,
        machine=machine,
        policy=policy,
        true_body_state=scenario.true_body_state,
        sensor_noise=scenario.sensor_noise,
        intervention=intervention,
    )
    hold = controller.hold
    if policy is None:
        builder.ExportInput(hold.get_action_input_port(), "actions")
    for name, port in controller.acting.items():
        builder.ExportOutput(port, name)
    limited = scenario.limits_targets(policy)
    targets = JointTargets(robot, actuated_joints(plant), limited=limited)
    builder.AddNamedSystem("joint_targets", targets)
    desired_state = plant.get_desired_state_input_port(instance)
    builder.Connect(_acting_action(builder, scenario, hold), targets.get_action_input_port())
    builder.Connect(targets.get_desired_state_output_port(), desired_state)
    judged = _add_judges(
        builder, robot, scenario, state, command, foot_sensor, machine, hold, limited
    )
    if meshcat is not None:
        AddLocomotionDisplay(
            builder,
            scene_graph,
            robot,
            gait,
            state=state,
            rm_state=machine.get_rm_state_output_port(),
            foot_contact=foot_sensor.get_foot_contact_output_port(),
            meshcat=meshcat,
        )

    exported = {
        "observations": controller.observation,
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


def AddNoise(  # noqa: N802
    builder: DiagramBuilder, name: str, share: float, size: int
) -> OutputPort | None:
    """Adds a source of numbers from 0 to 1, new ones every control step; None where share is 0."""
    if share == 0:
        return None
    noise = RandomSource(RandomDistribution.kUniform, size, CONTROL_PERIOD)
    return builder.AddNamedSystem(name, noise).get_output_port()


def _sensed_contact(
    builder: DiagramBuilder,
    scenario: Scenario,
    foot_sensor: FootSensor,
    noise: OutputPort | None,
) -> OutputPort:
    """Returns the contacts that the machine reads."""
    contact = foot_sensor.get_foot_contact_output_port()
    if noise is None:
        return contact
    sensors = builder.AddNamedSystem("contact_sensors", ContactNoise(scenario.contact_flips))
    builder.Connect(contact, sensors.get_foot_contact_input_port())
    builder.Connect(noise, sensors.get_uniform_noise_input_port())
    return sensors.get_sensed_contact_output_port()


def _acting_action(builder: DiagramBuilder, scenario: Scenario, hold: ActionHold) -> OutputPort:
    """Returns the action that the joints follow."""
    held = hold.get_held_action_output_port()
    if scenario.latency == 0:
        return held
    delay = ActionDelay(scenario.latency, scenario.station.time_step)
    builder.AddNamedSystem("action_delay", delay)
    builder.Connect(held, delay.get_held_action_input_port())
    return delay.get_delayed_action_output_port()


def _add_judges(
    builder: DiagramBuilder,
    robot: Robot,
    scenario: Scenario,
    state: OutputPort,
    command: OutputPort,
    foot_sensor: FootSensor,
    machine: RewardMachineSystem,
    hold: ActionHold,
    limited: bool,
) -> dict[str, OutputPort]:
    reward = RewardSystem(robot, scenario.weights, limit_targets=limited)
    builder.AddNamedSystem("reward", reward)
    monitor = builder.AddNamedSystem("fall_monitor", FallMonitor(robot, scenario.limits))
    connect = builder.Connect
    for system in (reward, monitor):
        connect(state, system.get_state_input_port())
        connect(hold.get_held_action_output_port(), system.get_action_input_port())
        connect(hold.get_previous_action_output_port(), system.get_previous_action_input_port())
    connect(command, reward.get_command_input_port())
    connect(foot_sensor.get_foot_contact_output_port(), reward.get_foot_contact_input_port())
    connect(foot_sensor.get_foot_height_output_port(), reward.get_foot_height_input_port())
    connect(machine.get_reward_multiplier_output_port(), reward.get_reward_multiplier_input_port())
    return {
        "reward": reward.get_reward_output_port(),
        "plain_reward": reward.get_plain_reward_output_port(),
        "reward_terms": reward.get_reward_terms_output_port(),
        "failures": monitor.get_failures_output_port(),
    }
