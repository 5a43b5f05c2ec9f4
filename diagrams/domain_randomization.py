"""Domain randomization of training: loads, motors, grounds, delays and pushes."""

from collections.abc import Sequence
from dataclasses import field, replace
from typing import Annotated, Any, ClassVar

import numpy as np
from annotated_types import Ge, Gt, Le, MinLen

from glassgait.diagrams.station import MUJOCO_CONTACT_TIME, StationConfig
from glassgait.models.errors import InputError
from glassgait.models.estimation.sensors import ImuErrors
from glassgait.models.robots.robot import DEFAULT_LAW, JointLaw, Robot
from glassgait.models.settings import FEW, IN_ORDER, Count, NotNegative, Positive, Settings, checked
from glassgait.models.task.randomization import Randomization
from glassgait.models.task.terrain import FLATTEST, Kind, Terrain

Range = Annotated[tuple[NotNegative, NotNegative], IN_ORDER]
Share = Annotated[float, Ge(0.0), Le(1.0)]

HARSH = Randomization(
    heading=180.0,
    friction=(0.4, 1.25),
    push_speed=2.5,
    push_interval=5.0,
    encoder_bias=0.02,
    imu=ImuErrors(gyroscope_bias=0.05, accelerometer_bias=0.3, attitude_bias=0.02),
    contact_flips=0.02,
    stuck_share=0.05,
    straight=0.2,
    latency=(0.0, 0.03),
)
"""Randomization of robots and episodes in training."""


@checked
class TerrainRanges(Settings):
    """Ranges from which the grounds of groups of robots are drawn."""

    title: ClassVar[str] = "terrains"

    share: Share = 0.75  # share of the groups; the others have the station's ground
    # Kinds of ground, assigned in turn; planes are slopes.
    kinds: Annotated[tuple[Kind, ...], FEW, MinLen(1)] = (
        "plane",
        "blocks",
        "plane",
        "steps",
        "plane",
        "uneven",
    )
    slope: Annotated[float, Ge(0.0), Le(45.0)] = 25.0  # greatest angle (°), in any direction
    # Greatest height of the highest cell of blocks and uneven ground above the lowest (m).
    amplitude: Annotated[float, Gt(0.0), Le(1.0)] = 0.07
    # Greatest height of a step (m). Steps lead up and down again, endlessly up, or endlessly down.
    height: Annotated[float, Gt(0.0), Le(1.0)] = 0.07
    patches: Share = 0.0  # share of cells with another friction

    def draw(self, ground: Terrain, count: int, generator: np.random.Generator) -> list[Terrain]:
        """Draws the grounds of `count` groups; a share of 0 draws no random numbers."""
        drawn = round(self.share * count)
        if drawn == 0:
            return [ground] * count
        grounds = [self._draw_one(i, drawn, generator) for i in range(drawn)]
        order = generator.permutation(count)
        return [grounds[i] if i < drawn else ground for i in order]

    def _draw_one(self, i: int, count: int, generator: np.random.Generator) -> Terrain:
        turn, index = divmod(i, len(self.kinds))
        kind = self.kinds[index]
        # Split the range by rounds, as `GroupRanges` does by groups; the greatest values are first.
        rounds = -(-count // len(self.kinds))
        share = (rounds - turn - generator.random()) / rounds
        direction, seed = generator.uniform(0.0, 360.0), int(generator.integers(2**31))
        if kind == "plane":
            return Terrain(slope=self.slope * share, direction=direction)
        common: dict[str, Any] = {"kind": kind, "patches": self.patches, "seed": seed}
        if kind == "steps":
            upward = (1.0, 1.0, -1.0)[turn % 3]
            height = max(FLATTEST, self.height * share)
            return Terrain(height=upward * height, endless=turn % 3 > 0, **common)
        return Terrain(amplitude=max(FLATTEST, self.amplitude * share), **common)


@checked
class GroupRanges(Settings):
    """Ranges from which the stations of groups of robots are drawn.

    Each range is divided into one interval per group, and each group draws from its interval, so
    that few groups cover the range.
    """

    title: ClassVar[str] = "groups"

    payload: Range = (0.0, 5.0)  # mass on the trunk (kg)
    # Greatest distance from the trunk's centre, along each horizontal axis (m).
    payload_offset: Annotated[float, Ge(0.0), Le(1.0)] = 0.08
    motor_strength: Range = (0.8, 1.2)  # factor on torque
    gains: Range = (0.8, 1.2)  # factors on stiffness and damping, drawn separately
    armature: Range = (0.0, 0.01)  # inertia of the rotors (kg·m²)
    relaxation_time: Range = (0.005, 0.03)  # of contacts (s)
    terrains: TerrainRanges = field(default_factory=TerrainRanges)

    def draw(
        self, robot: Robot, station: StationConfig, count: int, generator: np.random.Generator
    ) -> list[StationConfig]:
        """Draws variations of `station` for `count` groups of a robot."""

        def spread(least: float, greatest: float) -> list[float]:
            shares = (generator.permutation(count) + generator.random(count)) / count
            return (least + (greatest - least) * shares).tolist()

        # Another order of draws would change the results of a seed.
        masses, strengths = spread(*self.payload), spread(*self.motor_strength)
        stiffness, damping = spread(*self.gains), spread(*self.gains)
        rotors, relaxation_times = spread(*self.armature), spread(*self.relaxation_time)
        x, y = (spread(-self.payload_offset, self.payload_offset) for _ in range(2))
        grounds = self.terrains.draw(station.terrain, count, generator)

        # Gains are factors of the station's gains.
        nominal_stiffness, nominal_damping = station.gains(robot)
        return [
            replace(
                station,
                payload=masses[i],
                payload_position=(x[i], y[i], 0.0),
                motor_strength=strengths[i],
                stiffness=_scaled(nominal_stiffness, stiffness[i]),
                damping=_scaled(nominal_damping, damping[i]),
                armature=rotors[i],
                relaxation_time=relaxation_times[i],
                terrain=grounds[i],
            )
            for i in range(count)
        ]


def _scaled(gain: float | tuple[float, ...], factor: float) -> float | tuple[float, ...]:
    return tuple(factor * x for x in gain) if isinstance(gain, tuple) else factor * gain


@checked
class DomainRandomization(Settings):
    """Randomization of robots, and of the stations that groups of robots share."""

    title: ClassVar[str] = "domain randomization"

    n_groups: Count = 16
    groups: GroupRanges = field(default_factory=GroupRanges)
    # Time steps (s), shorter than the station's, each of one Drake group.
    fine_steps: Annotated[tuple[Positive, ...], FEW] = ()
    # Share of the groups that MuJoCo simulates, where all bodies collide.
    mujoco_share: Annotated[NotNegative, Le(1.0)] = 0.875
    mujoco_step: Positive = 0.005  # time step of MuJoCo groups (s)
    # Time constant of MuJoCo's contacts (s); see `StationConfig`.
    mujoco_contact_time: Annotated[float, Ge(1e-3), Le(1.0)] = MUJOCO_CONTACT_TIME
    station: StationConfig = field(default_factory=lambda: StationConfig(feet_only=True))
    randomization: Randomization = HARSH

    def __post_init__(self) -> None:
        if len(self.fine_steps) > self.n_groups:
            raise InputError(
                f"{self.title}: {len(self.fine_steps)} fine_steps do not fit in n_groups = "
                f"{self.n_groups}; raise n_groups or give fewer fine_steps"
            )

    def stations(
        self, robot: Robot, generator: np.random.Generator, law: JointLaw = DEFAULT_LAW
    ) -> list[StationConfig]:
        """Draws the station of every group; gains that the station lacks come from the law."""
        station = self.station.with_gains(robot, law)
        drawn = self.groups.draw(robot, station, self.n_groups, generator)
        fine = [
            replace(station, time_step=step)
            for station, step in zip(drawn, self.fine_steps, strict=False)
        ]

        # MuJoCo has no relaxation time, and collides all bodies at little cost.
        others = drawn[len(fine) :]
        mujoco = [
            replace(
                station,
                engine="mujoco",
                time_step=self.mujoco_step,
                contact_time=self.mujoco_contact_time,
                feet_only=False,
                relaxation_time=self.station.relaxation_time,
            )
            for station in others[: round(self.mujoco_share * self.n_groups)]
        ]
        return [*mujoco, *others[len(mujoco) :], *fine]


def at_hardship(stations: Sequence[StationConfig], hardship: float) -> list[StationConfig]:
    """Scales the slopes and heights of the stations' grounds by a factor, the hardship."""
    return [replace(station, terrain=station.terrain.scaled(hardship)) for station in stations]
