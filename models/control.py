"""One control step, from a robot's sensors to its joint targets.

    command ──────────────────────────────────┐
    sensors ─► contacts ─► reward machine ─► observation ─► policy ─► limits ─► joint targets
       └──────────┴──────► estimate ──────────┘

The functions are pure and take robots along the leading axes. The batch simulator calls them for
many robots, the systems of the diagram wrap them, and the exported C has one section for each.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

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
from glassgait.models.task.observation import N_ESTIMATED, are_sound, proprioception
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


def sound_readings(sensors: Sensors, *, imu: bool = True) -> Sensors:
    """Replaces a robot's readings except contacts by NaN if one is unsound; `imu` adds the IMU."""
    readings = sensors.joint_position, sensors.joint_velocity, sensors.imu
    sound = are_sound(*readings[: 3 if imu else 2])[..., None]
    position, velocity, reading = (np.where(sound, one, np.nan) for one in readings)
    return Sensors(position, velocity, sensors.touching, reading)


def _chosen(which: BoolArray, ours: Any, others: Any) -> Any:
    """Returns nested arrays with the values of `ours` for some robots (...), else of `others`."""
    return map_arrays(lambda one, other: np.where(which.T, one.T, other.T).T, ours, others)


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
        read = sound_readings(sensors, imu=self.needs_imu)
        last = self.initial(read.joint_position.shape[:-1]) if before is None else before
        memory, _ = self.sense(last, read, command)
        action = policy(self.observation(memory, read, command))
        memory = memory._replace(action=self.limited(memory, read, action))

        # A robot with an unsound reading or estimate keeps its previous memory.
        odometry, position = memory.odometry, read.joint_position
        feet = odometry.footholds.reshape(*position.shape[:-1], -1)
        estimated = odometry.velocity, feet, odometry.turning, memory.estimate
        memory = _chosen(are_sound(position, *estimated), memory, last)
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
        observe the machine's state. A robot whose readings are NaN (see `sound_readings`) keeps its
        memory; odometry begins at the first step with other readings.

        Args:
            before: The memory of the previous step; None at an episode's first step.
            true_height: Heights of the feet (..., 4; m), used if there is no estimator.
            difficulty: See `RewardMachine.step`.
        """
        position = sensors.joint_position
        last = self.initial(position.shape[:-1]) if before is None else before
        sound = np.isfinite(position[..., 0])

        height = last.estimate[..., -quadruped.N_LEGS :] if true_height is None else true_height

        def expected_height() -> Array:
            # Odometry predicts them, because this step's contacts are not known yet.
            if true_height is not None or not isinstance(self.estimator, Odometry):
                return height
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
            moves=sound,
        )

        # The estimate comes last, because a network observes the machine's state.
        odometry = last.odometry
        if isinstance(self.estimator, Odometry):
            odometry = self.estimator.advance(
                self.robot,
                last.odometry,
                joint_position=position,
                joint_velocity=sensors.joint_velocity,
                imu=sensors.imu,
                touching=contacts.touching,
            )
            begins = (last.trust.reading == UNREAD).all(axis=-1)
            if begins.any():
                odometry = _chosen(begins, self.estimator.begin(self.robot, position), odometry)
        memory = last._replace(trust=contacts.trust, machine=machine.machine, odometry=odometry)
        return self.estimated(_chosen(sound, memory, last), sensors, command), machine

    def initial(self, shape: tuple[int, ...]) -> Memory:
        """Returns the memory before the first step, for robots in an array of this shape."""
        stance = np.broadcast_to(self.robot.default_stance, (*shape, quadruped.N_JOINTS))
        return Memory(
            trust=ContactTrust.begin(shape),
            machine=self.machine.initial(shape),
            odometry=Odometry().begin(self.robot, stance),
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
        sound = np.isfinite(sensors.joint_position[..., :1])
        return memory._replace(estimate=np.where(sound, estimate, memory.estimate))

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
