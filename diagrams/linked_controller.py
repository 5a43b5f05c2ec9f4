"""A robot's controller, which meets the robot over LCM."""

from pydrake.lcm import DrakeLcmInterface
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort, TriggerType
from pydrake.systems.lcm import LcmPublisherSystem

from glassgait.diagrams.controller import AddController, Sensed, Senses
from glassgait.models.errors import InputError
from glassgait.models.link.channels import Channels
from glassgait.models.link.messages import targets_t
from glassgait.models.policies.controller import Controller
from glassgait.models.robots.joint_law import OWN_LAW
from glassgait.models.robots.robot import Robot
from glassgait.models.task.gait import Gait
from glassgait.systems.command_receiver import CommandReceiver
from glassgait.systems.reward_machine import RewardMachineSystem
from glassgait.systems.sensors_receiver import SensorsReceiver
from glassgait.systems.targets_sender import TargetsSender

TARGETS_PUBLISHER = "targets_publisher"


def MakeLinkedController(  # noqa: N802
    robot: Robot, gait: Gait, policy: Controller, lcm: DrakeLcmInterface, channels: Channels
) -> Diagram:
    """Builds the controller of `MakeLocomotion` between messages in place of a plant.

    .. pydrake_system::

        name: LinkedController
        input_ports:
        - sensors
        - command
        output_ports:
        - actions
        - observations
        - rm_state

    Inputs: sensors (sensors_t), which are answered. command (command_t).
    Outputs: actions (12) of this control step, observations, rm_state (n_states,
    one-hot). Messages: `targets_t` is sent when its publisher is forced to; see
    `glassgait.diagrams.link.ControllerEnd`, which hears the others.

    Args:
        robot: The robot.
        gait: The gait whose reward machine runs.
        policy: The controller; sensors measure no body state, so it needs an estimator.
        lcm: Where messages go.
        channels: Names of the channels.

    Raises:
        InputError: if a policy was made for another gait or observation, has no estimator, or
            learned with joints of other gains than the robot's own, which messages do not hold.
    """
    gains, own = policy.joint_law.gains_of(robot), OWN_LAW.gains_of(robot)
    if gains != own:
        raise InputError(
            f"the {gait.name}'s policy learned with joints of gains {gains}, and the robot's own "
            f"end drives them by {own}, those of its robot.yaml; write the policy's there, or take "
            "another policy"
        )
    builder = DiagramBuilder()
    message = AddAnsweringController(builder, robot, gait, policy)
    publisher = LcmPublisherSystem.Make(
        channels.targets, targets_t, lcm, publish_triggers={TriggerType.kForced}
    )
    builder.AddNamedSystem(TARGETS_PUBLISHER, publisher)
    builder.Connect(message, publisher.get_input_port())
    diagram = builder.Build()
    diagram.set_name("LinkedController")
    return diagram


def MakeAnsweringController(robot: Robot, gait: Gait, policy: Controller) -> Diagram:  # noqa: N802
    """Builds the same controller without a wire: the answer is an output port.

    .. pydrake_system::

        name: AnsweringController
        input_ports:
        - sensors
        - command
        output_ports:
        - actions
        - observations
        - rm_state
        - targets

    Ports as those of `MakeLinkedController`; targets (targets_t) is the answer.

    Raises:
        InputError: if a policy was made for another gait or observation, or has no estimator.
    """
    builder = DiagramBuilder()
    builder.ExportOutput(AddAnsweringController(builder, robot, gait, policy), "targets")
    diagram = builder.Build()
    diagram.set_name("AnsweringController")
    return diagram


def AddAnsweringController(  # noqa: N802
    builder: DiagramBuilder, robot: Robot, gait: Gait, policy: Controller
) -> OutputPort:
    """Adds a controller between messages, with ports as those of `MakeLinkedController`.

    Returns:
        The answer (targets_t).
    """
    receiver = builder.AddNamedSystem("sensors_receiver", SensorsReceiver())
    builder.ExportInput(receiver.get_message_input_port(), "sensors")
    commander = builder.AddNamedSystem("command_receiver", CommandReceiver(gait))
    builder.ExportInput(commander.get_message_input_port(), "command")
    sensed = Sensed(
        joints=receiver.get_joints_output_port(),
        command=commander.get_command_output_port(),
        commanded_dwell=commander.get_commanded_dwell_output_port(),
        touching=receiver.get_touching_output_port(),
        imu=receiver.get_imu_output_port(),
    )
    machine = builder.AddNamedSystem("reward_machine", RewardMachineSystem(gait))
    controller = AddController(
        builder,
        robot,
        gait,
        sensed,
        machine=machine,
        policy=policy,
        senses=Senses.of(policy),
        limited=True,  # The robot's end follows no others, whatever the policy.
    )
    sender = builder.AddNamedSystem("targets_sender", TargetsSender(robot))
    builder.Connect(controller.acting["actions"], sender.get_action_input_port())
    builder.ConnectInput("sensors", sender.get_sensors_input_port())
    builder.ExportOutput(controller.acting["actions"], "actions")
    builder.ExportOutput(controller.observation, "observations")
    builder.ExportOutput(machine.get_rm_state_output_port(), "rm_state")
    return sender.get_message_output_port()
