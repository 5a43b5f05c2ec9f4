"""One control step: what stands between a robot's sensors and its joints.

    command ──────────────────────────────────┐
    sensors ─► contacts ─► reward machine ─► observation ─► policy ─► limits ─► joint targets
       └──────────┴──────► estimate ──────────┘

The functions are pure and batch-first: robots stand along the first axes. The batch simulator calls
them for many robots. The systems of the diagram are shells over the same parts, and the C of an
exported controller has them as sections.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from glassgait.models.arrays import Array, map_arrays
from glassgait.models.estimation.odometry import Odometry, OdometryState
from glassgait.models.estimation.sensors import (
    N_IMU,
    UNREAD,
    BoolArray,
    ContactTrust,
    ImuReading,
    believed_contacts,
)
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import JointLaw, Robot
from glassgait.models.task.command import Command
from glassgait.models.task.observation import LARGEST_SOUND, N_ESTIMATED, proprioception
from glassgait.models.task.reward_machine import MachineState, MachineStep, RewardMachine

NO_READING: Array = np.full(N_IMU, np.nan)  # of a robot without an IMU
NO_READING.flags.writeable = False


class Sensors(NamedTuple):
    """Readings of a control instant."""

    joint_position: Array  # (..., 12; rad)
    joint_velocity: Array  # (..., 12; rad/s)
    touching: BoolArray  # whether each contact sensor reads a contact (..., 4)
    imu: Array = NO_READING  # (..., 9), where something needs it


class Memory(NamedTuple):
    """Memory of a controller between two control steps."""

    trust: ContactTrust
    machine: MachineState
    odometry: OdometryState
    estimate: Array  # the body state (..., 7; m/s, m); zeros without an estimator
    action: Array  # the one that the joints follow (..., 12)


def _are_sound(*values: Array) -> BoolArray:
    return np.asarray((np.abs(np.concatenate(values, axis=-1)) <= LARGEST_SOUND).all(axis=-1))


@dataclass(frozen=True)
class ControlStep:
    """The control step of a robot in a gait, without the policy."""

    robot: Robot
    machine: RewardMachine
    law: JointLaw
    # Odometry, or what maps proprioception to the body state (..., 7); None where the true body
    # state is observed.
    estimator: Callable[[Array], Array] | Odometry | None
    observes_imu: bool = False  # whether gravity's direction and the angular velocity are observed

    @property
    def needs_imu(self) -> bool:
        """True if the IMU is read."""
        uses = isinstance(self.estimator, Odometry) or self.law.limits is not None
        return self.observes_imu or uses

    def step(
        self,
        before: Memory | None,
        sensors: Sensors,
        command: Command,
        policy: Callable[[Array], Array],
    ) -> tuple[Array, Memory]:
        """Returns joint targets (..., 12; rad), and what to remember until the next step.

        For a robot with a reading or an estimate that is not finite or beyond `LARGEST_SOUND`
        nothing changes. One whose policy asks for such an action keeps its targets.
        """
        # Readings that are not sound are replaced, so that the others are computed undisturbed.
        position, velocity, touching, imu = sensors
        sound = _are_sound(position, velocity, *([imu] if self.needs_imu else []))
        position = np.where(sound[..., None], position, self.robot.default_stance)
        velocity, imu = (np.where(sound[..., None], one, 0.0) for one in (velocity, imu))
        read = Sensors(position, velocity, touching, imu)

        # A robot whose first readings were not sound begins now.
        if before is not None and (before.trust.reading == UNREAD).all():
            before = None
        memory, _ = self.sense(before, read, command)
        action = policy(self.observation(memory, read, command))
        memory = memory._replace(action=self.limited(memory, read, action))

        # Keep the memory of the step before where something is not sound.
        odometry, last = memory.odometry, self.initial(position) if before is None else before
        feet = odometry.footholds.reshape(*sound.shape, -1)
        sound &= _are_sound(odometry.velocity, feet, odometry.turning, memory.estimate)
        memory = map_arrays(lambda now, was: np.where(sound.T, now.T, was.T).T, memory, last)
        return self.joint_targets(memory.action), memory

    def sense(
        self,
        before: Memory | None,
        sensors: Sensors,
        command: Command,
        *,
        true_height: Array | None = None,
        difficulty: float = 1.0,
    ) -> tuple[Memory, MachineStep]:
        """Reads the sensors: contacts, reward machine and estimate.

        The machine reads the foot heights that were estimated a step before, since an estimator may
        observe the machine's state.

        Args:
            before: What is remembered of the step before; None at an episode's first step.
            true_height: Heights of the feet (..., 4; m), read where there is no estimator.
            difficulty: See `RewardMachine.step`.
        """
        last = self.initial(sensors.joint_position) if before is None else before

        height = last.estimate[..., -quadruped.N_LEGS :] if true_height is None else true_height

        def expected_height() -> Array:
            # Before it is known which feet touch.
            if true_height is not None or not isinstance(self.estimator, Odometry):
                return height
            position = sensors.joint_position
            return self.estimator.expected_heights(self.robot, last.odometry, position)

        # Contacts, of which a stuck sensor may say nothing true.
        contacts = believed_contacts(last.trust, sensors.touching, expected_height)

        # The reward machine. It follows the believed contacts.
        machine = self.machine.step(
            last.machine,
            foot_contact=contacts.contact,
            foot_height=height,
            commanded_dwell=command.dwell,
            difficulty=difficulty,
        )

        # The estimate. A network's observes the machine's state, so it comes last.
        odometry = last.odometry
        if isinstance(self.estimator, Odometry) and before is not None:
            odometry = self.estimator.advance(
                self.robot,
                last.odometry,
                joint_position=sensors.joint_position,
                joint_velocity=sensors.joint_velocity,
                imu=sensors.imu,
                touching=contacts.touching,
            )
        memory = Memory(contacts.trust, machine.machine, odometry, last.estimate, last.action)
        return self.estimated(memory, sensors, command), machine

    def initial(self, joint_position: Array) -> Memory:
        """Returns what is remembered before the first step of robots (..., 12; rad) at rest."""
        shape = joint_position.shape[:-1]
        return Memory(
            trust=ContactTrust.begin(shape),
            machine=self.machine.initial(shape),
            odometry=Odometry().begin(self.robot, joint_position),
            estimate=np.zeros((*shape, N_ESTIMATED)),
            action=np.zeros((*shape, quadruped.N_JOINTS)),
        )

    def estimated(self, memory: Memory, sensors: Sensors, command: Command) -> Memory:
        """Returns the memory with the body state that is estimated at this instant."""
        match self.estimator:
            case None:
                return memory
            case Odometry() as odometry:
                position = sensors.joint_position
                estimate = odometry.body_state(self.robot, memory.odometry, position)
            case network:
                estimate = network(self.proprioception(memory, sensors, command))
        return memory._replace(estimate=estimate)

    def proprioception(self, memory: Memory, sensors: Sensors, command: Command) -> Array:
        """Observes the part that needs no estimator (..., 40 + n_states; with an IMU 6 more)."""
        return proprioception(
            self.robot,
            command=command.velocity,
            joint_position=sensors.joint_position,
            joint_velocity=sensors.joint_velocity,
            previous_action=memory.action,
            rm_state=self.machine.one_hot(memory.machine.state),
            rm_iterations=memory.machine.iterations.astype(float),
            commanded_dwell=command.dwell,
            imu=sensors.imu if self.observes_imu else None,
            limited=self.law.limited,
        )

    def observation(
        self, memory: Memory, sensors: Sensors, command: Command, body: Array | None = None
    ) -> Array:
        """Observes everything (..., 47 + n_states; with an IMU 6 more).

        The body state (..., 7) is the estimate, or what is given as true.
        """
        body = memory.estimate if body is None else body
        return np.concatenate([self.proprioception(memory, sensors, command), body], axis=-1)

    def limited(self, memory: Memory, sensors: Sensors, action: Array) -> Array:
        """Returns what limits leave of the actions (..., 12) that a policy asks for.

        A robot keeps its last action where not all that is asked is finite.
        """
        if self.law.limits is None:
            finite = np.isfinite(action).all(axis=-1, keepdims=True)
            return np.where(finite, action, memory.action)
        return self.law.limits.applied(
            self.robot,
            action,
            before=memory.action,
            position=sensors.joint_position,
            gravity=ImuReading.of(sensors.imu).gravity,
        )

    def joint_targets(self, action: Array) -> Array:
        """Returns the joint targets (..., 12; rad) of actions."""
        return self.robot.joint_targets(action, limited=self.law.limited)
