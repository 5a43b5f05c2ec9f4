"""A robot's controller between messages, with the wire or without."""

from pydrake.lcm import DrakeLcmInterface
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort, TriggerType
from pydrake.systems.lcm import LcmPublisherSystem

from glassgait.diagrams.acting import Acting
from glassgait.models.errors import InputError
from glassgait.models.link.channels import Channels
from glassgait.models.link.messages import targets_t
from glassgait.models.robots.joint_law import OWN_LAW
from glassgait.systems.command_receiver import CommandReceiver
from glassgait.systems.sensors_receiver import SensorsReceiver
from glassgait.systems.targets_sender import TargetsSender

TARGETS_PUBLISHER = "targets_publisher"


def MakeLinkedController(  # noqa: N802
    acting: Acting, lcm: DrakeLcmInterface, channels: Channels
) -> Diagram:
    """Builds a controller that meets its robot over LCM.

    .. pydrake_system::

        name: LinkedController
        input_ports:
        - sensors
        - command
        - requested_gait
        output_ports:
        - actions
        - observations
        - rm_state
        - mode
        - status

    Inputs: sensors (sensors_t), which are answered. command (command_t). requested_gait (1), only
    of a compiled controller of several gaits: the number of the one that is to run; without it the
    first does.
    Outputs: actions (12) of this control step. mode (1), with a day. Of a policy in Python,
    observations and rm_state (n_states, one-hot); of a compiled controller status (1). Messages:
    `targets_t` is sent when its publisher is forced to; see
    `glassgait.diagrams.link.ControllerEnd`, which hears the others.

    Args:
        acting: What answers.
        lcm: Where messages go.
        channels: Names of the channels.

    Raises:
        InputError: if its parts do not suit each other, or it learned with joints of other gains
            than the robot's own, which messages do not hold.
    """
    gains, own = acting.joint_law.gains_of(acting.robot), OWN_LAW.gains_of(acting.robot)
    if gains != own:
        raise InputError(
            f"{acting.title} learned with joints of gains {gains}, and the robot's own end drives "
            f"them by {own}, those of its robot.yaml; write the policy's there, or take another "
            "policy"
        )
    builder = DiagramBuilder()
    message = AddAnsweringController(builder, acting)
    publisher = LcmPublisherSystem.Make(
        channels.targets, targets_t, lcm, publish_triggers={TriggerType.kForced}
    )
    builder.AddNamedSystem(TARGETS_PUBLISHER, publisher)
    builder.Connect(message, publisher.get_input_port())
    diagram = builder.Build()
    diagram.set_name("LinkedController")
    return diagram


def MakeAnsweringController(acting: Acting) -> Diagram:  # noqa: N802
    """Builds the same controller without a wire: the answer is an output port.

    .. pydrake_system::

        name: AnsweringController
        input_ports:
        - sensors
        - command
        - requested_gait
        output_ports:
        - actions
        - observations
        - rm_state
        - mode
        - status
        - targets

    Ports as those of `MakeLinkedController`; targets (targets_t) is the answer.

    Raises:
        InputError: if its parts do not suit each other.
    """
    builder = DiagramBuilder()
    builder.ExportOutput(AddAnsweringController(builder, acting), "targets")
    diagram = builder.Build()
    diagram.set_name("AnsweringController")
    return diagram


def AddAnsweringController(builder: DiagramBuilder, acting: Acting) -> OutputPort:  # noqa: N802
    """Adds a controller between messages, with ports as those of `MakeLinkedController`.

    Returns:
        The answer (targets_t).
    """
    receiver = builder.AddNamedSystem("sensors_receiver", SensorsReceiver())
    builder.ExportInput(receiver.get_message_input_port(), "sensors")
    commander = builder.AddNamedSystem("command_receiver", CommandReceiver(acting.limits))
    builder.ExportInput(commander.get_message_input_port(), "command")
    acted = acting.add(builder, receiver, commander)
    sender = TargetsSender(acting.robot, day=acting.day_digest)
    builder.AddNamedSystem("targets_sender", sender)
    builder.Connect(acted.action, sender.get_action_input_port())
    builder.ConnectInput("sensors", sender.get_sensors_input_port())
    if acted.damped is not None:
        builder.Connect(acted.damped, sender.get_damped_input_port())
    if acted.mode is not None:
        builder.Connect(acted.mode, sender.get_mode_input_port())
        builder.ExportOutput(acted.mode, "mode")
    for name, port in {"actions": acted.action, **acted.others}.items():
        builder.ExportOutput(port, name)
    return sender.get_message_output_port()
