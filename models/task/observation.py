"""The observation: its entries, named as in the paper's tables, assembly and mirror image."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from glassgait.models import BASE_VELOCITY_SCALE
from glassgait.models.arrays import Array, stacked
from glassgait.models.errors import InputError, shown
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task import MOST_STATES

JOINT_VELOCITY_SCALE = 0.05
ITERATIONS_SCALE = 0.1
ANGULAR_VELOCITY_SCALE = 0.25

# Half-widths of the uniform noise on joint positions (rad) and velocities (rad/s), and on all (24).
JOINT_POSITION_NOISE = 0.01
JOINT_VELOCITY_NOISE = 1.5
JOINT_NOISE: Array = np.repeat([JOINT_POSITION_NOISE, JOINT_VELOCITY_NOISE], quadruped.N_JOINTS)
JOINT_NOISE.flags.writeable = False

OVERDUE = 2
"""Control steps by which the observed time in a state may exceed the commanded one.

Longer waits are rare in the samples; students that observed the growing time waited and fell.
"""

LARGEST_SOUND = 1e6
"""Greatest magnitude of a sound reading, observation or action, as in the exported C."""

N_ESTIMATED = 7  # length of the estimated part: base velocity and foot heights

Group = Literal[
    "commanded velocity",
    "joint position",
    "joint velocity",
    "gravity",
    "angular velocity",
    "previous action",
    "machine state",
    "iterations",
    "commanded iterations",
    "base velocity",
    "foot height",
]

_FACTORS: dict[Group, float] = {
    "joint velocity": JOINT_VELOCITY_SCALE,
    "angular velocity": ANGULAR_VELOCITY_SCALE,
    "iterations": ITERATIONS_SCALE,
    "commanded iterations": ITERATIONS_SCALE,
    "base velocity": BASE_VELOCITY_SCALE,
}
"""Scale factors of observed quantities; the others have a factor of 1."""


@dataclass(frozen=True)
class ObservationEntry:
    """One number of the observation."""

    name: str  # as in policy files and tables, such as "DoF Vel FL Hip"
    group: Group  # the quantity; joint positions and previous actions are relative to the stance
    unit: str
    symbol: str  # such as "dq.FL_hip"
    latex: str
    merged_name: str  # the name without the leg or the number of the machine's state
    leg: str | None = None
    mirror_sign: float = 1.0  # -1 if the quantity changes its sign in the mirror

    @property
    def factor(self) -> float:
        """Scale factor that does not depend on the robot, in observations per unit."""
        return _FACTORS.get(self.group, 1.0)

    def scale(self, robot: Robot) -> float:
        """Returns the factor that converts the quantity in its unit to the observation."""
        return 1.0 / robot.action_scale if self.group == "previous action" else self.factor

    def scaled_unit(self, robot: Robot) -> str:
        """Returns the unit with the entry's scale factor."""
        if self.group == "previous action":
            return f"{robot.action_scale} rad of joint target"
        plain = {"joint position": "rad from the default stance", "machine state": "0 or 1"}
        scaled = self.unit if self.factor == 1.0 else f"{self.factor:g} · {self.unit}"
        return plain.get(self.group, scaled)


@dataclass(frozen=True)
class ObservationLayout:
    """Entries of the observation, in order, for a machine of `n_machine_states` states.

    The first part, proprioception, is measured or known; the last seven entries, the body state,
    come from an estimator. With `imu`, proprioception includes gravity's direction and the angular
    velocity from an IMU, which the paper's observation does not have.
    """

    n_machine_states: int
    imu: bool = field(default=False, kw_only=True)

    @classmethod
    def of(cls, names: Sequence[str]) -> "ObservationLayout":
        """Returns the layout of an observation, from the names of its entries."""
        entries = entries_of(names)
        states = sum(entry.group == "machine state" for entry in entries)
        return cls(states, imu=any(entry.group == "gravity" for entry in entries))

    @cached_property
    def entries(self) -> tuple[ObservationEntry, ...]:
        """All entries, in order."""
        imu = (
            *_of_axes("Gravity", "gravity", "", "g", "g", turned="y"),
            *_of_axes("Base Ang Vel", "angular velocity", "rad/s", "w", r"\omega", turned="xz"),
        )
        return (
            _entry("Command X", "commanded velocity", "m/s", "cmd.v", "v_x^{*}"),
            _entry("Command Yaw", "commanded velocity", "rad/s", "cmd.yaw", r"\omega_z^{*}", -1.0),
            *_of_joints("DoF Pos", "joint position", "rad", "q", "q"),
            *_of_joints("DoF Vel", "joint velocity", "rad/s", "dq", r"\dot q"),
            *(imu if self.imu else ()),
            *_of_joints("Prev Action", "previous action", "rad", "a", "a^{-}"),
            *map(_machine_state, range(self.n_machine_states)),
            _entry("RM Iters", "iterations", "control steps", "t", "n"),
            _entry("Command RM Iters", "commanded iterations", "control steps", "cmd.t", "n^{*}"),
            *_of_axes("Base Lin Vel", "base velocity", "m/s", "v", r"\hat v", turned="y"),
            *map(_foot_height, quadruped.LEGS),
        )

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of all entries, in order."""
        return tuple(entry.name for entry in self.entries)

    @property
    def size(self) -> int:
        """Length of the observation."""
        return len(self.names)

    @property
    def n_proprioceptive(self) -> int:
        """Length of the part that needs no estimator."""
        return self.size - N_ESTIMATED


def _entry(
    name: str, group: Group, unit: str, symbol: str, latex: str, sign: float = 1.0
) -> ObservationEntry:
    return ObservationEntry(name, group, unit, symbol, latex, merged_name=name, mirror_sign=sign)


def _of_axes(
    title: str, group: Group, unit: str, symbol: str, latex: str, *, turned: str
) -> list[ObservationEntry]:
    """Returns a quantity along each axis; the axes in `turned` change sign in the mirror."""
    signs = {axis: -1.0 if axis in turned else 1.0 for axis in "xyz"}
    return [
        _entry(
            f"{title} {axis.upper()}", group, unit, f"{symbol}.{axis}", f"{latex}_{{{axis}}}", sign
        )
        for axis, sign in signs.items()
    ]


def _of_joints(
    title: str, group: Group, unit: str, symbol: str, latex: str
) -> list[ObservationEntry]:
    return [
        ObservationEntry(
            name=f"{title} {leg} {joint.title()}",
            group=group,
            unit=unit,
            symbol=f"{symbol}.{leg}_{joint}",
            latex=rf"{latex}_{{\mathrm{{{leg}\,{joint}}}}}",
            merged_name=f"{title} {joint.title()}",
            leg=leg,
            mirror_sign=-1.0 if joint == "hip" else 1.0,
        )
        for leg in quadruped.LEGS
        for joint in quadruped.LEG_JOINTS
    ]


def _machine_state(number: int) -> ObservationEntry:
    name, latex = f"RM State {number}", f"s_{{{number}}}"
    return ObservationEntry(name, "machine state", "", f"s{number}", latex, "RM State")


def _foot_height(leg: str) -> ObservationEntry:
    name, latex = f"Foot Height {leg}", rf"\hat h_{{\mathrm{{{leg}}}}}"
    return ObservationEntry(name, "foot height", "m", f"h.{leg}", latex, "Foot Height", leg)


def entry_of(name: str) -> ObservationEntry:
    """Returns the entry with a name that a policy stores."""
    if name not in _entries_by_name():
        raise InputError(f"no observation is called {shown(name)}; make the policy anew")
    return _entries_by_name()[name]


def entries_of(names: Sequence[str]) -> tuple[ObservationEntry, ...]:
    """Returns the entries with these names, in the same order."""
    return tuple(entry_of(name) for name in names)


def symbols_of(names: Sequence[str]) -> tuple[str, ...]:
    """Returns the symbols, as in formulas, of the entries with these names."""
    return tuple(entry.symbol for entry in entries_of(names))


def indices_of(group: Group, names: Sequence[str]) -> tuple[int, ...]:
    """Returns the indices of a group's entries among the names of an observation."""
    return tuple(i for i, entry in enumerate(entries_of(names)) if entry.group == group)


def machine_state_entries(names: Sequence[str]) -> slice:
    """Returns the slice of an observation that holds the one-hot machine state."""
    indices = indices_of("machine state", names)
    if not indices:
        raise InputError("the policy does not observe the machine's state; make it anew")
    return slice(indices[0], indices[-1] + 1)


@cache
def _entries_by_name() -> dict[str, ObservationEntry]:
    return {entry.name: entry for entry in ObservationLayout(MOST_STATES, imu=True).entries}


def are_sound(*values: Array) -> NDArray[np.bool_]:
    """Returns whether all entries of the arrays (..., k) are finite and within ±`LARGEST_SOUND`."""
    return np.asarray((np.abs(np.concatenate(values, axis=-1)) <= LARGEST_SOUND).all(axis=-1))


def proprioception(
    robot: Robot,
    *,
    command: Array,
    joint_position: Array,
    joint_velocity: Array,
    previous_action: Array,
    rm_state: Array,
    rm_iterations: Array,
    commanded_dwell: Array,
    imu: Array | None = None,
    limited: bool = False,
) -> Array:
    """Assembles the part of the observation that needs no estimator (..., 40 + n_states).

    Robots are along the leading axes of all arrays; units are rad, rad/s, m/s and control steps.

    Args:
        rm_iterations: Control steps in the state, observed up to `OVERDUE` beyond the command.
        imu: The IMU's reading (..., 9), if the policy observes it; it adds six entries.
        limited: Whether targets are clipped to the joints' ranges. Then the clipped action is
            observed: a policy that multiplies its previous action could otherwise let it grow.
    """
    held = np.minimum(rm_iterations, np.add(commanded_dwell, OVERDUE))
    counts = stacked(held, commanded_dwell)
    measured_by_imu = () if imu is None else (imu[..., 6:9], ANGULAR_VELOCITY_SCALE * imu[..., 0:3])
    # All entries, in the order of `ObservationLayout.entries`.
    return np.concatenate(
        [
            command,
            joint_position - robot.default_stance,
            joint_velocity * JOINT_VELOCITY_SCALE,
            *measured_by_imu,
            robot.limited_action(previous_action) if limited else previous_action,
            rm_state,
            counts * ITERATIONS_SCALE,
        ],
        axis=-1,
    )


def overdue(observation: Array, names: Sequence[str]) -> NDArray[np.bool_]:
    """Returns which robots (...) have stayed in a state for `OVERDUE` steps beyond the command."""
    (spent,), (commanded,) = (
        indices_of(group, names) for group in ("iterations", "commanded iterations")
    )
    excess = (observation[..., spent] - observation[..., commanded]) / ITERATIONS_SCALE
    return np.rint(excess) >= OVERDUE


MIRRORED_LEGS = {"FL": "FR", "FR": "FL", "RL": "RR", "RR": "RL"}

MIRRORED_LEG_ORDER = np.array([quadruped.LEGS.index(MIRRORED_LEGS[leg]) for leg in quadruped.LEGS])
"""Index of each leg's mirror image (4)."""


@dataclass(frozen=True)
class Reflection:
    """The mirror image of a vector: its entries in the order of `index` (n), times `sign` (n)."""

    index: NDArray[np.int64]
    sign: Array

    def __call__(self, values: Array) -> Array:
        """Maps vectors (..., n) to their mirror images (..., n)."""
        return values[..., self.index] * self.sign

    def split(self, count: int) -> tuple["Reflection", "Reflection"]:
        """Returns the reflections of the first `count` entries and of the others."""
        first = Reflection(self.index[:count], self.sign[:count])
        return first, Reflection(self.index[count:] - count, self.sign[count:])


def reflect_observation(names: Sequence[str], states: Sequence[int]) -> Reflection:
    """Returns the reflection of observations, by their names and the gait's `mirrored_states`."""
    entries = entries_of(names)
    index = [names.index(_image_name(entry, states)) for entry in entries]
    return Reflection(np.array(index), np.array([entry.mirror_sign for entry in entries]))


def _image_name(entry: ObservationEntry, states: Sequence[int]) -> str:
    if entry.group == "machine state":
        number = int(entry.name.removeprefix(f"{entry.merged_name} "))
        return f"{entry.merged_name} {states[number]}"
    if entry.leg is None:
        return entry.name
    return entry.name.replace(entry.leg, MIRRORED_LEGS[entry.leg])


REFLECT_JOINTS = Reflection(
    np.arange(quadruped.N_JOINTS).reshape(quadruped.N_LEGS, -1)[MIRRORED_LEG_ORDER].ravel(),
    np.tile([-1.0, 1.0, 1.0], quadruped.N_LEGS),
)
"""The reflection of joint positions, velocities and actions (12): hips turn the other way."""
