"""A robot's day as data: modes such as rest, rise, stand and walk, and what leads from one to
another, read from a YAML file.

A mode says what the joints do: they go to a posture in so many seconds, follow the policy, or are
damped alone. It is left when a boolean formula holds over the `PROPOSITIONS`. One formula, the
fault, leads from every other mode to one that damps, and comes before all others.
`glassgait.models.task.mode_machine` steps it.
"""

import hashlib
from collections import deque
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations
from pathlib import Path
from typing import Annotated, ClassVar, Final

import numpy as np
from annotated_types import Ge, Gt, Le, MaxLen, MinLen
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError, brief, shown
from glassgait.models.files import read_yaml
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.quadruped import JOINTS, LEGS
from glassgait.models.robots.robot import Robot
from glassgait.models.robots.target_limits import TargetLimits
from glassgait.models.settings import NotNegative, Settings, checked
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.formula import Formula, Names, parse_formula, valuations
from glassgait.models.task.gait_keys import LONGEST_DESCRIPTION, LONGEST_STATE, is_plain

DAY_DIRECTORY = Path(__file__).resolve().parent / "days"

SHIPPED = "day"
"""Name of the day that is meant where none is named."""

REQUESTS: Final = ("sit", "stand", "walk")
"""What the operator may request, by number."""

PROPOSITIONS: Final = Names(
    (*REQUESTS, "go", "halted", "done", "leaning", "level", "slow", "blind"),
    "proposition",
    "propositions",
    "walk & go & done",
)
"""What formulas are over. The first three are the request, of which one holds. `go`: the command
is to go or turn. `halted`: it has not been for the day's `halt`. `done`: the mode's seconds are
over. `leaning`, `level`: of the trunk, by the IMU's direction of gravity. `slow`: trunk and joints
hardly move. `blind`: readings have not been sound for the day's `blindness`."""

POLICY, DAMP, STANCE = "policy", "damp", "stance"
"""What joints do in a mode, besides going to a posture of the day's."""

LYING_HEIGHT = 0.12
"""Height of the trunk from which robots drop to their bellies where a day begins (m)."""

MOST_MODES = 32
"""Greatest number of modes."""

Degrees = Annotated[float, Gt(0.0), Le(90.0)]
Seconds = Annotated[float, Ge(0.0), Le(60.0)]
Rates = Annotated[float, Gt(0.0), Le(100.0)]
Angle = Annotated[float, Ge(-7.0), Le(7.0)]
Leg = tuple[Angle, Angle, Angle]


@checked
class Posture(Settings):
    """Joint angles of a robot whose left and right legs are alike.

    Attributes:
        front: Of the front legs: hip, outward; thigh; calf (rad).
        rear: Of the rear legs.
    """

    title: ClassVar[str] = "posture"

    front: Leg
    rear: Leg

    def angles(self, robot: Robot) -> Array:
        """Returns the joint angles (12; rad)."""
        legs = np.array([self.front if leg[0] == "F" else self.rear for leg in LEGS])
        legs[:, 0] *= robot.side
        return legs.ravel()


@checked
class Mode(Settings):
    """What a robot does until something leads to another mode.

    Attributes:
        joints: `policy`, `damp`, `stance`, the robot's own, or the name of a posture.
        seconds: Time in which joints go to the posture; without one, after which it is `done` (s).
        next: The modes that it leads to, each with the formula in which it does.
    """

    title: ClassVar[str] = "mode"

    joints: str
    seconds: Seconds = 0.0
    next: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Edge:
    """A change from a mode to another.

    Attributes:
        source: Mode that it leaves; the fault is one edge of each mode.
        target: Mode that it enters.
        when: Propositions in which it does.
    """

    source: str
    target: str
    when: Formula


@checked
class Day(Settings):
    """A robot's day.

    Attributes:
        description: One sentence.
        initial: The mode at the start.
        modes: The modes by name.
        fault: One mode, which damps, and the formula in which every other one leads there; it comes
            before all other changes.
        postures: Postures by name.
        lean: Lean of the trunk beyond which it is `leaning` (°).
        level: Lean up to which it is `level` (°).
        turning: Angular velocity about each axis of the trunk up to which it is `slow` (rad/s).
        joint_speed: Root mean square of the joints' velocities up to which they are (rad/s).
        speed: Commanded speed beyond which the command is to `go` (m/s).
        yaw_rate: Commanded yaw rate beyond which it is, too (rad/s).
        halt: Time without such a command after which the robot is `halted` (s).
        blindness: Time without sound readings after which it is `blind` (s).
    """

    title: ClassVar[str] = "day"

    description: Annotated[str, MinLen(1), MaxLen(LONGEST_DESCRIPTION)]
    initial: str
    modes: Annotated[dict[str, Mode], MinLen(2), MaxLen(MOST_MODES)]
    fault: Annotated[dict[str, str], MinLen(1), MaxLen(1)]
    lean: Degrees
    level: Degrees
    turning: Rates
    joint_speed: Rates
    speed: NotNegative
    yaw_rate: NotNegative
    halt: Seconds
    blindness: Seconds
    postures: dict[str, Posture] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in self.modes:
            if not is_plain(name, LONGEST_STATE):
                raise InputError(
                    f"modes has the key {shown(name)}; name modes by printable characters, "
                    f"{LONGEST_STATE} at most, with no space at the ends"
                )
        self._check_names()
        if self.level > self.lean:
            raise InputError(
                f"level is {self.level:g}, and lean {self.lean:g}; a trunk that is level may not "
                "lean too far: give a smaller level"
            )
        _check_reachability(self)
        _check_formulas(self)
        _check_beginning(self)
        for name in self.modes:
            _check_determinism([edge for edge in self.edges if edge.source == name])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the modes, in the order of their numbers."""
        return tuple(self.modes)

    @property
    def damped(self) -> str:
        """Name of the mode that the fault leads to."""
        return next(iter(self.fault))

    @cached_property
    def edges(self) -> tuple[Edge, ...]:
        """The changes, but for the fault."""
        return tuple(
            Edge(source, target, _read(text, f"modes.{source}.next.{target}"))
            for source, mode in self.modes.items()
            for target, text in mode.next.items()
        )

    @cached_property
    def fault_formula(self) -> Formula:
        """The propositions in which every other mode leads to the one that damps."""
        return _read(self.fault[self.damped], f"fault.{self.damped}")

    @cached_property
    def next_modes(self) -> NDArray[np.int64]:
        """The number of the mode that each leads to (n_modes, 1024), by the propositions' code."""
        names = self.names
        led = np.repeat(np.arange(len(names))[:, None], 2 ** len(PROPOSITIONS.names), axis=1)
        for edge in self.edges:
            led[names.index(edge.source), np.array(edge.when.table)] = names.index(edge.target)
        led[:, np.array(self.fault_formula.table)] = names.index(self.damped)
        led.flags.writeable = False
        return led

    def posture(self, mode: str, robot: Robot) -> Array | None:
        """Returns the joint angles (12; rad) that a mode's joints go to; None where they do not."""
        joints = self.modes[mode].joints
        if joints in (POLICY, DAMP):
            return None
        return robot.default_stance if joints == STANCE else self.postures[joints].angles(robot)

    def steps(self, mode: str) -> int:
        """Returns a mode's seconds in control steps."""
        return round(self.modes[mode].seconds / CONTROL_PERIOD)

    def check(self, robot: Robot, limits: TargetLimits | None = None) -> None:
        """Refuses a robot whose joints cannot take the day's postures.

        Raises:
            InputError: if a posture is beyond the joints' ranges, or what limits leave of them.
        """
        margin = 0.0 if limits is None else limits.margin
        low, high = robot.lower_limits + margin, robot.upper_limits - margin
        for name, posture in self.postures.items():
            angles = posture.angles(robot)
            for joint, angle, least, greatest in zip(JOINTS, angles, low, high, strict=True):
                if not least <= angle <= greatest:
                    raise InputError(
                        f"day: key 'postures.{name}' has {joint} at {angle:g} rad, and the "
                        f"{robot.name}'s targets are from {least:g} to {greatest:g}; give an angle "
                        "in this range"
                    )
            robot.check_lowered(angles, f"key 'postures.{name}' of the day")

    def digest(self) -> str:
        """Returns a digest of everything in the day."""
        return hashlib.sha256(repr(self).encode()).hexdigest()[:16]

    def _check_names(self) -> None:
        named = [("initial", self.initial), ("fault", self.damped)]
        for source, mode in self.modes.items():
            named += [(f"modes.{source}.next", target) for target in mode.next]
            known = (POLICY, DAMP, STANCE, *self.postures)
            if mode.joints not in known:
                raise InputError(
                    f"key 'modes.{source}.joints' is {shown(mode.joints)}; it is one of "
                    f"{brief(', '.join(known))}"
                )
        for key, name in named:
            if name not in self.modes:
                raise InputError(
                    f"key {key!r} names unknown mode {shown(name)}; the modes are "
                    f"{brief(', '.join(self.modes))}"
                )
        for name in self.postures:
            if name in (POLICY, DAMP, STANCE):
                raise InputError(f"key 'postures.{name}': the name is taken; give it another")
        if self.modes[self.initial].joints != DAMP:
            raise InputError(
                f"key 'initial' is {shown(self.initial)}, whose joints are not damped; the robot "
                f"may lie in any way, so begin with a mode with joints: {DAMP}"
            )
        if self.modes[self.damped].joints != DAMP:
            raise InputError(
                f"key 'fault' leads to {shown(self.damped)}, whose joints are not damped; name a "
                f"mode with joints: {DAMP}"
            )


def load_day(day: str | Path = SHIPPED) -> Day:
    """Loads the day that ships, or one of one's own.

    Args:
        day: `day`, which ships, or path of a file that ends in .yaml.

    Raises:
        InputError: if there is no such day, or its file breaks a rule; the message names the file,
            the key and the remedy.
    """
    path = Path(day)
    if path.suffix not in (".yaml", ".yml"):
        if str(day) not in day_names():
            raise InputError(
                f"unknown day {shown(str(day))}; there is {', '.join(day_names())}, or give the "
                "path of a file ending in .yaml"
            )
        path = DAY_DIRECTORY / f"{day}.yaml"
    return Day.from_plain(read_yaml(path), str(path))


def day_of(digest: str) -> Day | None:
    """Returns the day of a digest, of those that ship; None where there is none."""
    return next((own for own in map(load_day, day_names()) if own.digest() == digest), None)


def lying_state(robot: Robot, day: Day, errors: Array) -> Array:
    """Returns plant states x (n, 37) of robots a little above their bellies, legs folded.

    Args:
        robot: The robot.
        day: The day, whose first posture the legs have.
        errors: What is added to the joint angles (n, 12; rad), within their ranges.
    """
    folded = next((own.angles(robot) for own in day.postures.values()), robot.default_stance)
    angles = np.clip(folded + errors, robot.lower_limits, robot.upper_limits)
    state = kinematics.standing_state(robot, angles)
    # A view: the trunk's height.
    height = state[:, quadruped.POSITION][:, 2]
    np.maximum(height, LYING_HEIGHT, out=height)
    return state


def day_names() -> tuple[str, ...]:
    """Lists the days that ship with the project."""
    return tuple(sorted(path.stem for path in DAY_DIRECTORY.glob("*.yaml")))


def possible() -> NDArray[np.bool_]:
    """Returns which codes of propositions can hold (1024): one request, and no contradiction."""
    holds = dict(zip(PROPOSITIONS.names, valuations(len(PROPOSITIONS.names)).T, strict=True))
    one_request = sum(holds[request].astype(int) for request in REQUESTS) == 1
    contradictions = (holds["leaning"] & holds["level"]) | (holds["go"] & ~holds["walk"])
    return one_request & ~contradictions


def _read(text: str, key: str) -> Formula:
    try:
        return parse_formula(text, PROPOSITIONS)
    except InputError as error:
        raise InputError(f"key {key!r}: {error}") from error


def _check_reachability(day: Day) -> None:
    reached, frontier = {day.initial, day.damped}, deque([day.initial, day.damped])
    _ = day.fault_formula
    while frontier:
        source = frontier.popleft()
        for target in day.modes[source].next:
            if target not in reached:
                reached.add(target)
                frontier.append(target)
    for name in day.modes:
        if name not in reached:
            raise InputError(
                f"mode {shown(name)} cannot be reached from {shown(day.initial)}; lead to it by "
                "the key 'next' of a mode, or remove it"
            )


def _check_formulas(day: Day) -> None:
    """Refuses formulas that never hold, and a fault that unsound readings do not make."""
    can_be = possible()
    for edge in day.edges:
        if not (np.array(edge.when.table) & can_be).any():
            raise InputError(
                f"key 'modes.{edge.source}.next.{edge.target}': {shown(edge.when.text)} never holds"
                "; mend it, or remove the key"
            )
    fault = np.array(day.fault_formula.table)
    if not fault[1 << PROPOSITIONS.names.index("blind")] or fault[0]:
        raise InputError(
            f"key 'fault.{day.damped}': {shown(day.fault_formula.text)} must hold where 'blind' is "
            "all that is known, and not where nothing is; write it as 'leaning | blind'"
        )


def _check_beginning(day: Day) -> None:
    """Refuses a day that may leave its first mode at its first step.

    A motion begins where joints were sent at the step before, and then they were sent nowhere; and
    a robot's end sees by the first answer that its joints are to be damped.
    """
    without_done = ~valuations(len(PROPOSITIONS.names))[:, PROPOSITIONS.names.index("done")]
    if day.steps(day.initial) < 1:
        raise InputError(
            f"key 'modes.{day.initial}.seconds' is {day.modes[day.initial].seconds:g}; the day "
            f"begins there, and stays for a control step at least: give {CONTROL_PERIOD:g} or more"
        )
    for edge in day.edges:
        if edge.source == day.initial and (np.array(edge.when.table) & without_done).any():
            raise InputError(
                f"key 'modes.{edge.source}.next.{edge.target}': {shown(edge.when.text)} may hold "
                "before the mode's seconds are over, in which the day begins; add '& done'"
            )


def _check_determinism(edges: list[Edge]) -> None:
    for first, second in combinations(edges, 2):
        if (np.array(first.when.table) & np.array(second.when.table) & possible()).any():
            raise InputError(
                f"key 'modes.{first.source}.next': {first.target} and {second.target} can be led "
                f"to together; make {shown(first.when.text)} and {shown(second.when.text)} exclude "
                "each other"
            )
