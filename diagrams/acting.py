"""What answers a robot's sensors: a policy with all around it in Python, or a compiled controller.

Ends of a wire know neither. They know an `Acting`, which adds itself to a diagram between the
messages of sensors and of commands and the answer.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

from pydrake.systems.framework import DiagramBuilder, OutputPort

from glassgait.diagrams.controller import AddController, Sensed, Senses
from glassgait.models.errors import InputError
from glassgait.models.export.binding import LoadedController
from glassgait.models.export.contract import Contract
from glassgait.models.policies.controller import Controller
from glassgait.models.robots.joint_law import JointLaw
from glassgait.models.robots.robot import Robot
from glassgait.models.task.command import CommandRange
from glassgait.models.task.day import Day
from glassgait.models.task.gait import Gait
from glassgait.systems.command_receiver import CommandReceiver
from glassgait.systems.compiled_controller import CompiledController
from glassgait.systems.reward_machine import RewardMachineSystem
from glassgait.systems.sensors_receiver import SensorsReceiver


@dataclass(frozen=True)
class ActedPorts:
    """What a controller gives between messages.

    Attributes:
        action: What joints are asked for (12).
        damped: Of a day, whether joints are to have no stiffness (1).
        mode: Of a day, the number of its mode (1).
        others: What else is to be seen of it, by name.
    """

    action: OutputPort
    damped: OutputPort | None
    mode: OutputPort | None
    others: dict[str, OutputPort]


class Acting(ABC):
    """A controller that answers sensors.

    Attributes:
        robot: The robot that it moves.
        day: The day that it lives through, if it does and its day is known.
    """

    robot: Robot
    day: Day | None

    @property
    @abstractmethod
    def title(self) -> str:
        """What messages for people call it."""

    @property
    @abstractmethod
    def joint_law(self) -> JointLaw:
        """How joints are to follow its targets."""

    @property
    @abstractmethod
    def limits(self) -> CommandRange:
        """The commands that it is made for."""

    @property
    @abstractmethod
    def gaits(self) -> Sequence[str]:
        """Names of the gaits that it walks in, in the order of their numbers."""

    @property
    @abstractmethod
    def has_day(self) -> bool:
        """Whether it lives through a day, and begins damped with the robot on its belly."""

    @property
    @abstractmethod
    def day_digest(self) -> str:
        """Digest of that day; empty without one."""

    @abstractmethod
    def add(
        self, builder: DiagramBuilder, receiver: SensorsReceiver, commander: CommandReceiver
    ) -> ActedPorts:
        """Adds it to a diagram, behind what reads messages.

        Raises:
            InputError: if its parts do not suit each other.
        """


@dataclass(frozen=True)
class PolicyActing(Acting):
    """A policy, with the systems that `MakeLocomotion` has around it.

    Attributes:
        robot: The robot.
        gait: The gait whose reward machine runs.
        policy: The controller; sensors measure no body state, so it needs an estimator.
        day: The robot's day, whose modes decide when the policy acts; it always does by default.
    """

    robot: Robot
    gait: Gait
    policy: Controller
    day: Day | None = None

    @property
    def title(self) -> str:
        """What messages for people call it."""
        return f"the {self.gait.name}'s policy"

    @property
    def gaits(self) -> Sequence[str]:
        """Names of the gaits that it walks in."""
        return (self.gait.name,)

    @property
    def joint_law(self) -> JointLaw:
        """How joints are to follow its targets."""
        return self.policy.joint_law

    @property
    def limits(self) -> CommandRange:
        """The commands that it is made for."""
        return self.gait

    @property
    def has_day(self) -> bool:
        """Whether it lives through a day."""
        return self.day is not None

    @property
    def day_digest(self) -> str:
        """Digest of that day; empty without one."""
        return "" if self.day is None else self.day.digest()

    def add(
        self, builder: DiagramBuilder, receiver: SensorsReceiver, commander: CommandReceiver
    ) -> ActedPorts:
        """Adds it to a diagram, behind what reads messages.

        Raises:
            InputError: if the policy was made for another gait or observation, or has no estimator,
                or the robot's joints cannot take the day's postures.
        """
        sensed = Sensed(
            joints=receiver.get_joints_output_port(),
            command=commander.get_command_output_port(),
            commanded_dwell=commander.get_commanded_dwell_output_port(),
            touching=receiver.get_touching_output_port(),
            imu=receiver.get_imu_output_port(),
        )
        machine = builder.AddNamedSystem("reward_machine", RewardMachineSystem(self.gait))
        controller = AddController(
            builder,
            self.robot,
            self.gait,
            sensed,
            machine=machine,
            policy=self.policy,
            senses=Senses.of(self.policy),
            limited=True,  # The robot's end follows no others, whatever the policy.
            day=self.day,
        )
        seen = {
            "observations": controller.observation,
            "rm_state": machine.get_rm_state_output_port(),
        }
        modes = controller.modes
        if modes is None:
            return ActedPorts(controller.acting["actions"], None, None, seen)
        requested = commander.get_requested_mode_output_port()
        builder.Connect(requested, modes.get_requested_mode_input_port())
        return ActedPorts(
            controller.acting["actions"],
            modes.get_damped_output_port(),
            modes.get_mode_output_port(),
            seen,
        )


@dataclass(frozen=True)
class CompiledActing(Acting):
    """A controller that was compiled from C.

    Of several gaits the one runs whose number the diagram's input `requested_gait` holds.

    Attributes:
        robot: The robot.
        compiled: Its functions.
        contract: What it needs of its robot.
        day: The day that was compiled into it, if one was and is known.
    """

    robot: Robot
    compiled: LoadedController
    contract: Contract
    day: Day | None = None

    @property
    def title(self) -> str:
        """What messages for people call it."""
        return f"the compiled controller {self.compiled.name}"

    @property
    def joint_law(self) -> JointLaw:
        """How joints are to follow its targets."""
        return self.compiled.joint_law

    @property
    def limits(self) -> CommandRange:
        """The commands that it is made for."""
        return self.contract

    @property
    def gaits(self) -> Sequence[str]:
        """Names of the gaits that it walks in."""
        return tuple(self.contract.gaits)

    @property
    def has_day(self) -> bool:
        """Whether it lives through a day."""
        return self.compiled.has_day

    @property
    def day_digest(self) -> str:
        """Digest of that day; empty without one."""
        return self.contract.day if self.has_day else ""

    def add(
        self, builder: DiagramBuilder, receiver: SensorsReceiver, commander: CommandReceiver
    ) -> ActedPorts:
        """Adds it to a diagram, behind what reads messages.

        Raises:
            InputError: if it does not keep its targets within the joints' ranges.
        """
        if not self.joint_law.limited:
            raise InputError(
                f"{self.title} asks for targets beyond the joints' ranges, which a robot's end "
                "does not follow; export a policy that learned with targets within them"
            )
        compiled = builder.AddNamedSystem("compiled_controller", CompiledController(self.compiled))
        inputs = {
            "joints": receiver.get_joints_output_port(),
            "touching": receiver.get_touching_output_port(),
            "imu": receiver.get_imu_output_port(),
            "command": commander.get_command_output_port(),
            "commanded_dwell": commander.get_commanded_dwell_output_port(),
            "requested_mode": commander.get_requested_mode_output_port(),
        }
        for name, port in inputs.items():
            if compiled.HasInputPort(name):
                builder.Connect(port, compiled.GetInputPort(name))
        if len(self.gaits) > 1:
            builder.ExportInput(compiled.GetInputPort("requested_gait"), "requested_gait")
        damped, mode = (
            compiled.GetOutputPort(name) if self.has_day else None for name in ("damped", "mode")
        )
        seen = {"status": compiled.get_status_output_port()}
        return ActedPorts(compiled.get_action_output_port(), damped, mode, seen)
