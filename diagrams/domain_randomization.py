"""Domain randomization: the loads, motors, grounds, delays and pushes that robots learn with."""

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
"""Differences between robots and episodes of training."""


@checked
class TerrainRanges(Settings):
    """Ranges of the grounds of groups of robots."""

    title: ClassVar[str] = "terrains"

    share: Share = 0.75  # of the groups; the others have the station's ground
    # In turn; planes are slopes.
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
    # Greatest height of a step (m). Steps lead up and down again, up for ever, or down.
    height: Annotated[float, Gt(0.0), Le(1.0)] = 0.07
    patches: Share = 0.0  # share of cells with another friction

    def draw(self, ground: Terrain, count: int, generator: np.random.Generator) -> list[Terrain]:
        """Draws the ground of `count` groups; without a share of them nothing is drawn."""
        drawn = round(self.share * count)
        if drawn == 0:
            return [ground] * count
        grounds = [self._draw_one(i, drawn, generator) for i in range(drawn)]
        order = generator.permutation(count)
        return [grounds[i] if i < drawn else ground for i in order]

    def _draw_one(self, i: int, count: int, generator: np.random.Generator) -> Terrain:
        # The kind goes round.
        turn, n_kinds = divmod(i, len(self.kinds))
        kind = self.kinds[n_kinds]
        # As with the other ranges, each group draws from another part, the greatest first.
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
    """Ranges of the stations of groups of robots.

    Every range is cut into as many parts as there are groups, and each group draws from another
    part, so that few groups cover the ranges.
    """

    title: ClassVar[str] = "groups"

    payload: Range = (0.0, 5.0)  # mass on the trunk (kg)
    # Greatest distance from the trunk's centre, along each horizontal axis (m).
    payload_offset: Annotated[float, Ge(0.0), Le(1.0)] = 0.08
    motor_strength: Range = (0.8, 1.2)  # factor on torque
    gains: Range = (0.8, 1.2)  # factors on stiffness and damping, each drawn by itself
    armature: Range = (0.0, 0.01)  # inertia of the rotors (kg·m²)
    relaxation_time: Range = (0.005, 0.03)  # of contacts (s)
    terrains: TerrainRanges = field(default_factory=TerrainRanges)

    def draw(
        self, robot: Robot, station: StationConfig, count: int, generator: np.random.Generator
    ) -> list[StationConfig]:
        """Draws the stations of `count` groups of a robot, as variations of `station`."""

        def spread(least: float, greatest: float) -> list[float]:
            shares = (generator.permutation(count) + generator.random(count)) / count
            return (least + (greatest - least) * shares).tolist()

        # The order of draws is part of a seed's meaning.
        masses, strengths = spread(*self.payload), spread(*self.motor_strength)
        stiffness, damping = spread(*self.gains), spread(*self.gains)
        rotors, relaxation_times = spread(*self.armature), spread(*self.relaxation_time)
        x, y = (spread(-self.payload_offset, self.payload_offset) for _ in range(2))
        grounds = self.terrains.draw(station.terrain, count, generator)

        # Gains vary around those of the station.
        nominal_stiffness, nominal_damping = station.gains(robot)
        return [
            replace(
                station,
                payload=masses[i],
                payload_position=(x[i], y[i], 0.0),
                motor_strength=strengths[i],
                stiffness=nominal_stiffness * stiffness[i],
                damping=nominal_damping * damping[i],
                armature=rotors[i],
                relaxation_time=relaxation_times[i],
                terrain=grounds[i],
            )
            for i in range(count)
        ]


@checked
class DomainRandomization(Settings):
    """The randomised stations of groups of robots, and the differences between robots."""

    title: ClassVar[str] = "domain randomization"

    n_groups: Count = 16
    groups: GroupRanges = field(default_factory=GroupRanges)
    # Time steps (s) of one group each, finer than the station's.
    fine_steps: Annotated[tuple[Positive, ...], FEW] = ()
    # Share of the groups, with contacts of all bodies; none of them has a fine step.
    mujoco_share: Annotated[NotNegative, Le(1.0)] = 0.875
    mujoco_step: Positive = 0.005  # of their plants (s)
    # Time constant (s); see `StationConfig`.
    mujoco_contact_time: Annotated[float, Ge(1e-3), Le(1.0)] = MUJOCO_CONTACT_TIME
    station: StationConfig = field(default_factory=lambda: StationConfig(feet_only=True))
    randomization: Randomization = HARSH

    def __post_init__(self) -> None:
        if len(self.fine_steps) > self.n_groups:
            raise InputError(
                f"{self.title}: {len(self.fine_steps)} fine_steps do not fit in n_groups = "
                f"{self.n_groups}; raise n_groups or name fewer"
            )
        if any(step >= self.station.time_step for step in self.fine_steps):
            raise InputError(
                f"{self.title}: fine_steps is {self.fine_steps}; name steps that are shorter than "
                f"the station's time_step, {self.station.time_step}"
            )

    def stations(
        self, robot: Robot, generator: np.random.Generator, law: JointLaw = DEFAULT_LAW
    ) -> list[StationConfig]:
        """Draws the physics of every group; the law gives gains that the station leaves out."""
        station = self.station.with_gains(robot, law)
        drawn = self.groups.draw(robot, station, self.n_groups, generator)
        fine = [
            replace(station, time_step=step)
            for station, step in zip(drawn, self.fine_steps, strict=False)
        ]

        # MuJoCo has no relaxation time, and all bodies collide in it at no great cost.
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
    """Returns stations with the angles and heights of their grounds multiplied by a hardship."""
    return [replace(station, terrain=station.terrain.scaled(hardship)) for station in stations]
