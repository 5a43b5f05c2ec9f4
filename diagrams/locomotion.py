"""The closed locomotion loop of one robot, as a systems diagram."""

from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort

from glassgait.diagrams.commands import AddCommand, AddGivenCommand
from glassgait.diagrams.controller import AddController, ControllerPorts, Sensed, Senses
from glassgait.diagrams.judges import AddJudges
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.sensed_robot import AddSensedRobot, SensedRobot
from glassgait.diagrams.station import actuated_joints
from glassgait.diagrams.visualization import AddLocomotionDisplay
from glassgait.models.policies.controller import Controller
from glassgait.models.policies.policy import Policy
from glassgait.models.task.gait import Gait
from glassgait.models.task.ground import Ground
from glassgait.systems.action_delay import ActionDelay
from glassgait.systems.action_hold import ActionHold
from glassgait.systems.foot_sensor import FootSensor
from glassgait.systems.joint_targets import JointTargets
from glassgait.systems.reward_machine import RewardMachineSystem


def MakeLocomotion(  # noqa: N802
    gait: Gait,
    scenario: Scenario | None = None,
    *,
    policy: Controller | Policy | None = None,
    senses: Senses | None = None,
    meshcat: Meshcat | None = None,
) -> Diagram:
    """Builds the station with the task and the policies around it.

    .. pydrake_system::

        name: Locomotion
        input_ports:
        - command
        - commanded_dwell
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
        - imu

    Inputs: command (2; m/s, rad/s) and commanded_dwell (1, control steps), from a planner, limited
    to what the gait is made for; each may stay unconnected, and then the scenario's command holds.
    actions (12), only where no policy is given.
    Outputs: actions (12), what acts at this control step. observations (47 + n_states, or 53 +
    n_states with an IMU). reward (1) and plain_reward (1) of the step that ends now, reward_terms
    (13). rm_state (n_states, one-hot), rm_iterations (1), served_dwell (1, control steps).
    foot_contact (4), foot_height (4, m). failures (7). command (2) and commanded_dwell (1), by
    which the robot goes. state (37), the plant's. imu (9), the IMU's reading, only where it is
    needed.

    Read the outputs at a control instant before its updates, as `Simulator.AdvanceTo` leaves them.
    In a default context the robot stands at rest. `SetRandomContext` draws the robot's pose, the
    sensors' noise and biases, and drawn commands. The scenario's pushes come between two control
    steps, from the code that advances the simulator; see `glassgait.diagrams.plant_state.push`.

    Args:
        gait: The gait whose reward machine runs.
        scenario: The world, and how the loop is closed; the training world by default.
        policy: The controller. Its estimator gives the observed body state and the foot heights
            that the reward machine reads; they are the true ones where the scenario says so, and
            where no policy is given.
        senses: Where no policy is given, what is observed by; the true body state by default.
        meshcat: Shows robot, contacts and machine state there.

    Raises:
        InputError: if a policy was made for another gait or observation, or has no estimator, and
            the scenario does not ask for the true body state; or the gait is not made for the
            command.
        ValueError: if commands come from sliders, and there is no Meshcat.
    """
    scenario = scenario or Scenario()
    if policy is not None:
        senses = Senses.of(policy, true_body_state=scenario.true_body_state)
    senses = senses or Senses()
    robot, joint_law = scenario.robot_of(policy), scenario.joint_law(policy)
    builder = DiagramBuilder()
    # What comes first draws first in a random context: a seed gives the same commands with noise
    # and without, and the same noise whatever the robot's pose is drawn from.
    drawn = AddCommand(builder, gait, scenario.command, meshcat)
    commanded = AddGivenCommand(builder, gait, drawn)
    sensed_robot = AddSensedRobot(
        builder, robot, scenario, imu=senses.need_imu, joint_law=joint_law
    )
    sensed = _sensed(sensed_robot, commanded)
    machine = builder.AddNamedSystem("reward_machine", RewardMachineSystem(gait))
    controller = AddController(
        builder,
        robot,
        gait,
        sensed,
        machine=machine,
        policy=policy,
        senses=senses,
        limited=joint_law.limited,
    )
    hold = controller.hold
    if policy is None:
        builder.ExportInput(hold.get_action_input_port(), "actions")
    _add_joint_targets(builder, sensed_robot, scenario, hold, limited=joint_law.limited)
    judged = AddJudges(builder, sensed_robot, scenario, sensed.command, machine, hold, joint_law)
    if meshcat is not None:
        rm_state = machine.get_rm_state_output_port()
        AddLocomotionDisplay(builder, sensed_robot, gait, rm_state, meshcat)
    _export_outputs(builder, sensed, sensed_robot.sensors.feet, machine, controller, judged)
    diagram = builder.Build()
    diagram.set_name("Locomotion")
    return diagram


def _sensed(sensed_robot: SensedRobot, commanded: tuple[OutputPort, OutputPort]) -> Sensed:
    """Returns what the controller and the reward machine read."""
    command, commanded_dwell = commanded
    sensors = sensed_robot.sensors
    return Sensed(
        joints=sensors.joints,
        command=command,
        commanded_dwell=commanded_dwell,
        touching=sensors.touching,
        imu=sensors.imu,
        state=sensed_robot.state,
        foot_height=sensors.feet.get_foot_height_output_port(),
        ground=Ground([sensed_robot.terrain]),
    )


def _add_joint_targets(
    builder: DiagramBuilder,
    sensed_robot: SensedRobot,
    scenario: Scenario,
    hold: ActionHold,
    *,
    limited: bool,
) -> None:
    """Lets the plant's joints follow the action that is held, as late as it comes."""
    joints = actuated_joints(sensed_robot.plant)
    targets = JointTargets(sensed_robot.robot, joints, limited=limited)
    builder.AddNamedSystem("joint_targets", targets)
    action = _acting_action(builder, scenario, hold)
    builder.Connect(action, targets.get_action_input_port())
    builder.Connect(targets.get_desired_state_output_port(), sensed_robot.desired_state)


def _acting_action(builder: DiagramBuilder, scenario: Scenario, hold: ActionHold) -> OutputPort:
    """Returns the action that the joints follow."""
    held = hold.get_held_action_output_port()
    if scenario.latency == 0:
        return held
    delay = ActionDelay(scenario.latency, scenario.station.time_step)
    builder.AddNamedSystem("action_delay", delay)
    builder.Connect(held, delay.get_held_action_input_port())
    return delay.get_delayed_action_output_port()


def _export_outputs(
    builder: DiagramBuilder,
    sensed: Sensed,
    feet: FootSensor,
    machine: RewardMachineSystem,
    controller: ControllerPorts,
    judged: dict[str, OutputPort],
) -> None:
    exported = {
        **controller.acting,
        "observations": controller.observation,
        **judged,
        "rm_state": machine.get_rm_state_output_port(),
        "rm_iterations": machine.get_rm_iterations_output_port(),
        "served_dwell": machine.get_served_dwell_output_port(),
        "foot_contact": feet.get_foot_contact_output_port(),
        "foot_height": feet.get_foot_height_output_port(),
        "command": sensed.command,
        "commanded_dwell": sensed.commanded_dwell,
        "state": sensed.state,
        "imu": sensed.imu,
    }
    for name, port in exported.items():
        if port is not None:
            builder.ExportOutput(port, name)
