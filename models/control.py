"""One control step, from a robot's sensors to its joint targets.

    command ──────────────────────────────────┐
    sensors ─► contacts ─► reward machine ─► observation ─► policy ─► limits ─► joint targets
       └──────────┴──────► estimate ──────────┘

The functions are pure and take robots along the leading axes. The batch simulator calls them for
many robots, the systems of the diagram wrap them, and the exported C has one section for each.
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

NO_READING: Array = np.full(N_IMU, np.nan)  # reading of a missing IMU
NO_READING.flags.writeable = False


class Sensors(NamedTuple):
    """Readings of a control instant."""

    joint_position: Array  # (..., 12; rad)
    joint_velocity: Array  # (..., 12; rad/s)
    touching: BoolArray  # whether each contact sensor reads a contact (..., 4)
    imu: Array = NO_READING  # (..., 9); only needed if `ControlStep.needs_imu`


class Memory(NamedTuple):
    """Memory of a controller between two control steps."""

    trust: ContactTrust
    machine: MachineState
    odometry: OdometryState
    estimate: Array  # the body state (..., 7; m/s, m); zeros without an estimator
    action: Array  # the action that the joints follow (..., 12)


def _are_sound(*values: Array) -> BoolArray:
    return np.asarray((np.abs(np.concatenate(values, axis=-1)) <= LARGEST_SOUND).all(axis=-1))


@dataclass(frozen=True)
class ControlStep:
    """The control step of a robot in a gait, without the policy."""

    robot: Robot
    machine: RewardMachine
    law: JointLaw
    # Odometry, or a function of proprioception that returns the body state (..., 7); None if the
    # true body state is observed.
    estimator: Callable[[Array], Array] | Odometry | None
    observes_imu: bool = False  # whether gravity's direction and the angular velocity are observed

    @property
    def needs_imu(self) -> bool:
        """True if the IMU is read."""
        has_odometry = isinstance(self.estimator, Odometry)
        return self.observes_imu or has_odometry or self.law.limits is not None

    def step(
        self,
        before: Memory | None,
        sensors: Sensors,
        command: Command,
        policy: Callable[[Array], Array],
    ) -> tuple[Array, Memory]:
        """Returns joint targets (..., 12; rad) and the memory for the next step.

        A robot keeps its memory if a reading or an estimate is not finite or exceeds
        `LARGEST_SOUND`. It keeps its targets if the policy's action is not finite.
        """
        # Replace unsound readings, so that they do not disturb the other robots.
        position, velocity, touching, imu = sensors
        sound = _are_sound(position, velocity, *([imu] if self.needs_imu else []))
        position = np.where(sound[..., None], position, self.robot.default_stance)
        velocity, imu = (np.where(sound[..., None], values, 0.0) for values in (velocity, imu))
        read = Sensors(position, velocity, touching, imu)

        # If the first readings were unsound, the episode begins now.
        if before is not None and (before.trust.reading == UNREAD).all():
            before = None
        memory, _ = self.sense(before, read, command)
        action = policy(self.observation(memory, read, command))
        memory = memory._replace(action=self.limited(memory, read, action))

        # A robot with an unsound reading or estimate keeps its previous memory.
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

        The machine reads the foot heights estimated in the previous step, since an estimator may
        observe the machine's state.

        Args:
            before: The memory of the previous step; None at an episode's first step.
            true_height: Heights of the feet (..., 4; m), used if there is no estimator.
            difficulty: See `RewardMachine.step`.
        """
        last = self.initial(sensors.joint_position) if before is None else before

        height = last.estimate[..., -quadruped.N_LEGS :] if true_height is None else true_height

        def expected_height() -> Array:
            # Odometry predicts them, because this step's contacts are not known yet.
            if true_height is not None or not isinstance(self.estimator, Odometry):
                return height
            position = sensors.joint_position
            return self.estimator.expected_heights(self.robot, last.odometry, position)

        # Contacts; the foot's height replaces a sensor that seems stuck.
        contacts = believed_contacts(last.trust, sensors.touching, expected_height)

        # The reward machine. It follows the believed contacts.
        machine = self.machine.step(
            last.machine,
            foot_contact=contacts.contact,
            foot_height=height,
            commanded_dwell=command.dwell,
            difficulty=difficulty,
        )

        # The estimate comes last, because a network observes the machine's state.
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
        """Returns the memory before the first step of robots at rest (..., 12; rad)."""
        shape = joint_position.shape[:-1]
        return Memory(
            trust=ContactTrust.begin(shape),
            machine=self.machine.initial(shape),
            odometry=Odometry().begin(self.robot, joint_position),
            estimate=np.zeros((*shape, N_ESTIMATED)),
            action=np.zeros((*shape, quadruped.N_JOINTS)),
        )

    def estimated(self, memory: Memory, sensors: Sensors, command: Command) -> Memory:
        """Returns the memory with a new estimate of the body state."""
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
        """Returns the observation without body state (..., 40 + n_states; 6 more with an IMU)."""
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
        """Returns the observation (..., 47 + n_states; 6 more with an IMU).

        `body` is the true body state (..., 7); by default it is the estimate.
        """
        body = memory.estimate if body is None else body
        return np.concatenate([self.proprioception(memory, sensors, command), body], axis=-1)

    def limited(self, memory: Memory, sensors: Sensors, action: Array) -> Array:
        """Limits a policy's actions (..., 12); a robot keeps its last one if any is not finite."""
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
