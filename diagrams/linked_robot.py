"""A simulated robot, which meets its controller over LCM."""

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.lcm import DrakeLcmInterface
from pydrake.systems.framework import Diagram, DiagramBuilder, TriggerType
from pydrake.systems.lcm import LcmPublisherSystem
from pydrake.systems.primitives import ConstantVectorSource, MatrixGain

from glassgait.diagrams.commands import AddCommand
from glassgait.diagrams.gait_machine import AddModeRequest
from glassgait.diagrams.judges import AddFallMonitor
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.sensed_robot import AddSensedRobot, SensedRobot
from glassgait.diagrams.sensors import Sensors
from glassgait.diagrams.station import actuated_joints
from glassgait.diagrams.visualization import AddLocomotionDisplay
from glassgait.models.errors import InputError
from glassgait.models.link.channels import Channels
from glassgait.models.link.messages import command_t, sensors_t
from glassgait.models.link.watchdog import Watchdog
from glassgait.models.robots import quadruped
from glassgait.models.task.day import Day
from glassgait.models.task.gait import Gait
from glassgait.systems.command_sender import CommandSender
from glassgait.systems.link_watchdog import LinkWatchdog
from glassgait.systems.sensors_sender import SensorsSender

WATCHDOG = "link_watchdog"
PUBLISHERS = ("command_publisher", "sensors_publisher")
"""In the order in which they are to send: sensors are answered with the command known."""


def MakeLinkedRobot(  # noqa: N802
    gait: Gait,
    scenario: Scenario,
    lcm: DrakeLcmInterface,
    channels: Channels,
    *,
    watchdog: Watchdog,
    session: int,
    meshcat: Meshcat | None = None,
    day: Day | None = None,
) -> Diagram:
    """Builds the station with messages in place of a controller, and a watchdog over them.

    .. pydrake_system::

        name: LinkedRobot
        input_ports:
        - answer
        - requested_mode
        output_ports:
        - state
        - failures
        - targets
        - phase
        - command

    Inputs: answer (targets_t), the controller's latest. requested_mode (1), only of a robot with
    a day and no buttons: the number of what the operator requests of its day.
    Outputs: state (37), the plant's. failures (7), less `abrupt_action`: actions are the
    controller's own. targets (12, rad), which the joints follow. phase (1), a number of `Phase`.
    command (2; m/s, rad/s). Messages: `command_t` and `sensors_t` are sent when their
    publishers are forced to; see `glassgait.diagrams.link.RobotEnd`, which receives the answers.

    Args:
        gait: The gait that commands are made for.
        scenario: The world.
        lcm: Where messages go.
        channels: Names of the channels.
        watchdog: How long the robot waits for its controller.
        session: Number of this start, not 0.
        meshcat: Shows robot and contacts there.
        day: The day that the robot is to live through: it lies, damped, until a controller answers.
            It stands by default.

    Raises:
        InputError: if the scenario is not made for two processes, or the gait not for the command.
        ValueError: if commands come from sliders, and there is no Meshcat.
    """
    refuse_unfit(scenario)
    robot = scenario.robot_of()
    builder = DiagramBuilder()
    # In the order of MakeLocomotion: a seed draws the same commands and the same noise.
    command, commanded_dwell = AddCommand(builder, gait, scenario.command, meshcat)
    sensed_robot = AddSensedRobot(builder, robot, scenario, imu=True)
    time_step = scenario.station.time_step
    guard = LinkWatchdog(robot, watchdog, session=session, time_step=time_step, day=day)
    _add_watchdog(builder, guard, sensed_robot)
    commander = builder.AddNamedSystem("command_sender", CommandSender(session))
    builder.Connect(command, commander.get_command_input_port())
    builder.Connect(commanded_dwell, commander.get_commanded_dwell_input_port())
    if day is not None:
        requested, mode = commander.get_requested_mode_input_port(), guard.get_mode_output_port()
        AddModeRequest(builder, day, requested, mode, scenario.command, meshcat)
    sender = _add_sensors_sender(builder, sensed_robot.sensors, guard, session)
    _add_publishers(builder, commander, sender, lcm, channels)
    if meshcat is not None:
        # The machine's state is known to the controller alone.
        unknown = builder.AddSystem(ConstantVectorSource(np.zeros(gait.n_states)))
        AddLocomotionDisplay(builder, sensed_robot, gait, unknown.get_output_port(), meshcat)
    exported = {
        "state": sensed_robot.state,
        "failures": AddFallMonitor(builder, sensed_robot, scenario),
        "targets": guard.get_targets_output_port(),
        "phase": guard.get_phase_output_port(),
        "command": command,
    }
    for name, port in exported.items():
        builder.ExportOutput(port, name)
    diagram = builder.Build()
    diagram.set_name("LinkedRobot")
    return diagram


def _add_watchdog(builder: DiagramBuilder, guard: LinkWatchdog, sensed_robot: SensedRobot) -> None:
    """Lets the plant's joints, in an order of its own, come to rest at the watchdog's targets."""
    builder.AddNamedSystem(WATCHDOG, guard)
    builder.ExportInput(guard.get_message_input_port(), "answer")
    builder.Connect(sensed_robot.state, guard.get_state_input_port())
    order = [quadruped.JOINTS.index(name) for name in actuated_joints(sensed_robot.plant)]
    at_rest = np.concatenate(
        [np.eye(quadruped.N_JOINTS)[order], np.zeros(2 * (quadruped.N_JOINTS,))]
    )
    gain = builder.AddNamedSystem("desired_state", MatrixGain(at_rest))
    builder.Connect(guard.get_targets_output_port(), gain.get_input_port())
    builder.Connect(gain.get_output_port(), sensed_robot.desired_state)


def _add_sensors_sender(
    builder: DiagramBuilder, sensors: Sensors, guard: LinkWatchdog, session: int
) -> SensorsSender:
    sender = builder.AddNamedSystem("sensors_sender", SensorsSender(session))
    builder.Connect(sensors.joints, sender.get_joints_input_port())
    builder.Connect(sensors.touching, sender.get_touching_input_port())
    assert sensors.imu is not None
    builder.Connect(sensors.imu, sender.get_imu_input_port())
    builder.Connect(guard.get_followed_output_port(), sender.get_followed_input_port())
    return sender


def _add_publishers(
    builder: DiagramBuilder,
    commander: CommandSender,
    sender: SensorsSender,
    lcm: DrakeLcmInterface,
    channels: Channels,
) -> None:
    sent = (
        (commander.get_message_output_port(), channels.command, command_t),
        (sender.get_message_output_port(), channels.sensors, sensors_t),
    )
    for name, (message, channel, kind) in zip(PUBLISHERS, sent, strict=True):
        forced = {TriggerType.kForced}
        publisher = LcmPublisherSystem.Make(channel, kind, lcm, publish_triggers=forced)
        builder.AddNamedSystem(name, publisher)
        builder.Connect(message, publisher.get_input_port())


def refuse_unfit(scenario: Scenario) -> None:
    """
    Raises:
        InputError: if a scenario is not made for two processes.
    """
    refused = {
        "station.time_step": (scenario.station.time_step == 0, "a step such as 0.01"),
        "contact_flips": (scenario.contact_flips > 0, "0"),
        "stuck_open": (bool(scenario.stuck_open), "none"),
        "stuck_closed": (bool(scenario.stuck_closed), "none"),
        "latency": (scenario.latency > 0, "0: messages take their own time"),
        "limit_targets": (
            scenario.limit_targets is False,
            "true: the robot's own end keeps targets within the joints' ranges",
        ),
        "true_body_state": (scenario.true_body_state, "false: sensors do not measure it"),
    }
    for name, (wrong, remedy) in refused.items():
        if wrong:
            raise InputError(
                f"{scenario.refused_as()}: {name} is not made for two processes; give {remedy}"
            )
