"""Randomization of robots and episodes: initial states, pushes, friction and noise."""

from dataclasses import KW_ONLY, field
from typing import Annotated, ClassVar, Literal

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.estimation.sensors import (
    IMU_NOISE,
    N_IMU,
    STUCK_CLOSED,
    STUCK_OPEN,
    ImuErrors,
    stuck_sensors,
)
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.settings import DISTINCT, FEW, IN_ORDER, NotNegative, Range, Settings, checked
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.ground import LEVEL_GROUND, Ground
from glassgait.models.task.observation import JOINT_NOISE

# Coulomb friction; with far greater values the contact solver ends the process.
Friction = Annotated[NotNegative, Le(1000.0)]
Legs = Annotated[tuple[Literal["FL", "FR", "RL", "RR"], ...], FEW, DISTINCT]
# Time from an observation until its action reaches the joints (s).
Latency = Annotated[NotNegative, Le(2 * CONTROL_PERIOD)]


@checked
class Disturbances(Settings):
    """Pushes and errors of the sensors, which scenarios and training share."""

    _: KW_ONLY
    # Greatest heading at an episode's start to either side of the world's x axis, along which
    # slopes and steps rise (°); 180 for any heading.
    heading: Annotated[float, Ge(0.0), Le(180.0)] = 0.0
    # Greatest horizontal velocity that a push adds to the trunk's, along each axis (m/s); 0 for no
    # pushes.
    push_speed: NotNegative = 0.0
    # Mean time between two pushes of a robot (s).
    push_interval: Annotated[float, Ge(CONTROL_PERIOD)] = 15.0
    sensor_noise: NotNegative = 1.0  # Factor on the noise of the joints' sensors and of the IMU.
    # Greatest constant error of each measured joint position in an episode (rad).
    encoder_bias: Annotated[NotNegative, Le(1.0)] = 0.0
    # Errors of the IMU's readings besides their noise.
    imu: ImuErrors = field(default_factory=ImuErrors)
    # Share of the contact sensors' readings that are wrong.
    contact_flips: Annotated[NotNegative, Le(1.0)] = 0.0
    stuck_open: Legs = ()  # Legs whose contact sensors never read a contact.
    stuck_closed: Legs = ()  # Legs whose contact sensors always read a contact.


@checked
class Randomization(Disturbances):
    """Ranges from which robots and episodes are drawn."""

    title: ClassVar[str] = "randomization"

    # Greatest horizontal velocity that a push adds to the trunk's, along each axis (m/s).
    push_speed: NotNegative = 1.0
    # Factors on the default stance, least and greatest, at an episode's start.
    joint_scale: Range = (0.5, 1.5)
    # Greatest initial base velocity along and about each axis (m/s, rad/s).
    base_velocity: NotNegative = 0.5
    # Least and greatest friction of the ground.
    friction: Annotated[tuple[Friction, Friction], IN_ORDER] = (0.5, 1.25)
    # Share of the episodes in which one more sensor is stuck, open or closed.
    stuck_share: Annotated[NotNegative, Le(1.0)] = 0.0
    straight: Annotated[NotNegative, Le(1.0)] = 0.0  # Share of the commands without a yaw rate.
    # Least and greatest time from an observation until its action reaches the joints (s), drawn for
    # each episode.
    latency: Annotated[tuple[Latency, Latency], IN_ORDER] = (0.0, 0.0)

    def initial_states(
        self,
        robot: Robot,
        count: int,
        generator: np.random.Generator,
        ground: Ground = LEVEL_GROUND,
    ) -> Array:
        """Draws plant states x (count, 37) of robots whose lowest foot touches the ground."""
        # Joints near the stance, the heading, and velocities.
        scale = generator.uniform(*self.joint_scale, size=(count, quadruped.N_JOINTS))
        joints = np.clip(robot.default_stance * scale, robot.lower_limits, robot.upper_limits)
        state = kinematics.standing_state(robot, joints)
        if self.heading > 0.0:
            half = 0.5 * np.radians(self.heading) * generator.uniform(-1.0, 1.0, size=count)
            state[:, 0], state[:, 3] = np.cos(half), np.sin(half)
        velocity = generator.uniform(-1.0, 1.0, size=(count, 6)) * self.base_velocity
        state[:, quadruped.ANGULAR_VELOCITY] = velocity[:, :3]
        state[:, quadruped.LINEAR_VELOCITY] = velocity[:, 3:]
        # Positions on the ground; on a plane, the position does not matter.
        if ground.is_level:
            return state
        state[:, quadruped.POSITION][:, :2] = ground.draw_places(count, generator)
        return ground.stand(robot, state)

    def joint_noise(self, count: int, generator: np.random.Generator) -> Array:
        """Draws noise on joint positions, then velocities (count, 24; rad, rad/s)."""
        noise = generator.uniform(-1.0, 1.0, size=(count, 2 * quadruped.N_JOINTS))
        return noise * (self.sensor_noise * JOINT_NOISE)

    def imu_noise(self, count: int, generator: np.random.Generator) -> Array:
        """Draws noise on the IMU's readings (count, 9; rad/s, m/s, no unit)."""
        noise = generator.uniform(-1.0, 1.0, size=(count, N_IMU))
        return noise * (self.sensor_noise * IMU_NOISE)

    def biases(self, count: int, generator: np.random.Generator) -> Array:
        """Draws constant errors of joint positions, then of the IMU (count, 21), if any."""
        joints = np.full(quadruped.N_JOINTS, self.encoder_bias)
        greatest = np.concatenate([joints, self.imu.half_widths])
        if not greatest.any():
            return np.zeros((count, len(greatest)))
        return generator.uniform(-1.0, 1.0, size=(count, len(greatest))) * greatest

    def latencies(self, count: int, generator: np.random.Generator) -> Array:
        """Draws the latencies of episodes (count,; s)."""
        least, greatest = self.latency
        # Draw nothing for a single value, so that later draws do not depend on it.
        if least == greatest:
            return np.full(count, least)
        return generator.uniform(least, greatest, size=count)

    def wrong_contacts(self, count: int, generator: np.random.Generator) -> NDArray[np.bool_]:
        """Draws which contact sensors read wrongly in a control step (count, 4)."""
        feet = (count, quadruped.N_LEGS)
        if self.contact_flips == 0.0:
            return np.zeros(feet, dtype=bool)
        return generator.random(feet) < self.contact_flips

    def stuck_contacts(self, count: int, generator: np.random.Generator) -> NDArray[np.int8]:
        """Returns the stuck contact sensors of episodes (count, 4); in some, one more is drawn."""
        stuck = np.tile(stuck_sensors(self.stuck_open, self.stuck_closed), (count, 1))
        if self.stuck_share == 0.0:
            return stuck
        which = np.flatnonzero(generator.random(count) < self.stuck_share)
        foot = generator.integers(quadruped.N_LEGS, size=len(which))
        stuck[which, foot] = generator.choice([STUCK_OPEN, STUCK_CLOSED], size=len(which))
        return stuck

    def pushes(self, count: int, generator: np.random.Generator) -> Array:
        """Draws the changes of base velocities by this control step's pushes (count, 3; m/s)."""
        if self.push_speed == 0:
            return np.zeros((count, 3))
        push = generator.uniform(-1.0, 1.0, size=(count, 3)) * self.push_speed
        push[:, 2] = 0.0
        pushed = generator.random(count) < CONTROL_PERIOD / self.push_interval
        return push * pushed[:, None]


NOMINAL = Randomization(
    joint_scale=(0.9, 1.1), base_velocity=0.1, friction=(1.0, 1.0), push_speed=0.0
)
"""The default of evaluations: near the stance, with noise, without pushes."""


def seed_of(number: Array) -> int:
    """Converts the 64 bits of a number (1,) to a seed."""
    (seed,) = np.array(number).view(np.uint64).tolist()
    return seed
