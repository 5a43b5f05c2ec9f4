"""What a robot does while its controller answers in time, late, or not at all.

Joints that follow targets do so as long as these are young. Then the last ones are held for a
moment, and then the robot is lowered to a crouch. It rises again when answers have come in time for
long enough and its trunk is level, and follows them once it stands.

A robot whose controller vanishes in the middle of a stride stands on two legs, and tips over the
line between their feet as long as the other two stay folded. So all four legs are first folded
alike, and at once: none pushes the trunk aside any more, and it drops between its feet. Then they
brace it, and only then is it lowered slowly.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from annotated_types import Ge, Le

from glassgait.models.arrays import Array
from glassgait.models.robots.robot import Robot
from glassgait.models.settings import Settings
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.mode_machine import eased

Seconds = Annotated[float, Ge(CONTROL_PERIOD), Le(60.0)]

SPREAD = 0.3
"""Angle by which the hips of a robot that is lowered stand outward (rad)."""


def spread_pose(calf: float) -> Array:
    """Returns joint targets (12; rad) of legs that are spread, and alike, each foot by its hip."""
    outward = SPREAD * np.array([1.0, -1.0, 1.0, -1.0])
    pose = np.stack([outward, np.full(4, -0.5 * calf), np.full(4, calf)], axis=1).ravel()
    pose.flags.writeable = False
    return pose


FOLDED = spread_pose(-2.6)
"""Joint targets of legs that let the trunk drop (12; rad)."""

BRACED = spread_pose(-2.1)
"""Joint targets of legs that stop it (12; rad)."""

CROUCH = spread_pose(-2.4)
"""Joint targets of a robot that is lowered (12; rad)."""

FOLDING, BRACING = 0.05, 0.1
"""Times in which the targets go to the former two (s)."""

_ROUNDING = 1e-6
"""Times in messages are whole microseconds (s)."""


class Phase(IntEnum):
    """What the joints do."""

    STANDING = 0
    """They go to the default stance, and wait there for a controller."""
    FOLLOWING = 1
    """They follow targets that answer the latest sensors."""
    HOLDING = 2
    """They follow the latest targets, which are late."""
    LOWERED = 3
    """They go to the crouch, and wait there until a controller answers steadily."""
    TIPPED = 4
    """They stay there although it does: the trunk leans too far to rise."""
    DAMPED = 5
    """They brake, as the controller asks."""
    LEFT = 6
    """They brake on although no answer comes: so they did when the last one came."""


@dataclass(frozen=True)
class Watchdog(Settings):
    """How long the robot waits for its controller.

    Attributes:
        hold: Greatest age of targets that joints follow (s), from the sensors that they answer;
            past it the robot is lowered.
        lowering: Time in which it is lowered (s), once its legs have caught it.
        recovery: Time for which answers must come in time before a lowered robot rises (s).
        rising: Time in which it rises (s).
        lean: Greatest lean of the trunk at which it rises (°).
    """

    title: ClassVar[str] = "watchdog"

    hold: Seconds = 0.1
    lowering: Seconds = 1.0
    recovery: Seconds = 0.5
    rising: Seconds = 1.5
    lean: Annotated[float, Ge(1.0), Le(90.0)] = 20.0


class Answer(NamedTuple):
    """What a controller answered.

    Attributes:
        session: The session of the sensors that it answers.
        time: Their time, by the robot's clock (s).
        targets: Joint position targets (12; rad).
        damped: Whether joints are to have no stiffness, whatever the targets are.
    """

    session: int
    time: float
    targets: Array
    damped: bool = False


class Watch(NamedTuple):
    """What the watchdog remembers.

    Attributes:
        phase: What the joints do, one of `Phase`.
        since: When they began to (s).
        answered: Time of the sensors that the newest answer is to (s).
        unsteady: When answers last were not in time (s).
        damped: Whether the newest answer asks for no stiffness.
        newest: Joint targets of that answer (12; rad).
        begin: Joint targets when the phase began (12; rad).
        targets: Joint targets now (12; rad).
    """

    phase: int
    since: float
    answered: float
    unsteady: float
    damped: bool
    newest: Array
    begin: Array
    targets: Array

    @property
    def followed(self) -> bool:
        """Whether the joints do what the controller answers."""
        return self.phase in (Phase.FOLLOWING, Phase.HOLDING, Phase.DAMPED)


def initial_watch(robot: Robot, *, lies: bool = False) -> Watch:
    """Returns the watch of a robot that has had no answer from a controller.

    Args:
        robot: The robot.
        lies: Whether it lies, damped, rather than stands.

    Raises:
        InputError: if the robot's legs cannot be folded as they are when it is lowered.
    """
    for pose in (FOLDED, BRACED, CROUCH):
        robot.check_lowered(pose, "the watchdog")
    stance = robot.default_stance
    phase, never = Phase.LEFT if lies else Phase.STANDING, -np.inf
    return Watch(phase, never, never, never, lies, stance, stance, stance)


def step_watch(
    robot: Robot,
    watch: Watch,
    answer: Answer | None,
    now: float,
    settings: Watchdog,
    *,
    position: Array,
    lean: float = 0.0,
) -> Watch:
    """Decides what the joints are to do.

    Args:
        robot: The robot.
        watch: The watch before.
        answer: The latest answer to this session's sensors that came, whether or not it was judged
            before; None before the first.
        now: Time by the robot's clock (s).
        settings: How long to wait.
        position: Joint positions (12; rad). Joints that are sent to where they are, brake alone.
        lean: Angle between the trunk's vertical axis and the world's (°).

    Returns:
        The watch now. An answer that is no news (see `is_news`) changes nothing. Of one that is,
        joints follow the nearest targets within their ranges.
    """
    if answer is not None and is_news(robot, answer, watch.answered, now):
        newest = _within_ranges(robot, answer.targets)
        watch = watch._replace(answered=answer.time, newest=newest, damped=answer.damped)
    age = now - watch.answered
    in_time = age <= CONTROL_PERIOD + _ROUNDING
    if not in_time:
        watch = watch._replace(unsteady=now)
    level = lean <= settings.lean
    phase = _next_phase(watch, age, in_time, now, settings, level=level)
    if phase != watch.phase:
        watch = watch._replace(phase=phase, since=now, begin=watch.targets)
    elapsed = now - watch.since
    match phase:
        case Phase.STANDING:
            targets = between(watch.begin, robot.default_stance, elapsed / settings.rising)
        case Phase.LOWERED:
            targets = lowering_targets(watch.begin, elapsed, settings)
        case Phase.TIPPED:
            targets = CROUCH
        case Phase.DAMPED | Phase.LEFT:
            targets = position
        case _:
            targets = watch.newest
    return watch._replace(targets=targets)


def is_news(robot: Robot, answer: Answer, answered: float, now: float) -> bool:
    """Decides whether joints are to follow an answer.

    Args:
        robot: The robot.
        answer: An answer to this session's sensors.
        answered: Time of the sensors that the newest answer so far is to (s).
        now: Time by the robot's clock (s).

    Returns:
        Whether it is newer, answers sensors that were sent already, and asks for targets that can
        be meant: finite, and no farther from the joints' ranges than where a joint within its range
        would be given all of its motor's torque; one beyond asks for no more, and is a mistake.
    """
    of_the_past = answered < answer.time <= now + _ROUNDING
    beyond = np.abs(answer.targets - _within_ranges(robot, answer.targets))
    return of_the_past and bool(np.all(beyond <= robot.effort / robot.stiffness))


def _within_ranges(robot: Robot, targets: Array) -> Array:
    return np.clip(targets, robot.lower_limits, robot.upper_limits)


def lowering_targets(begin: Array, elapsed: float, settings: Watchdog) -> Array:
    """Returns the joint targets of a robot that is lowered.

    Returns:
        Targets (12; rad), at rest at `begin`, `FOLDED`, `BRACED` and, for good, `CROUCH`.
    """
    pose = begin
    for end, seconds in ((FOLDED, FOLDING), (BRACED, BRACING), (CROUCH, settings.lowering)):
        pose = between(pose, end, elapsed / seconds)
        elapsed -= seconds
    return pose


def _next_phase(
    watch: Watch, age: float, in_time: bool, now: float, settings: Watchdog, *, level: bool
) -> Phase:
    phase, elapsed = Phase(watch.phase), now - watch.since
    lowered = elapsed >= FOLDING + BRACING + settings.lowering - _ROUNDING
    # An answer that is late still says that joints are to have no stiffness.
    if watch.damped and (phase is not Phase.LOWERED or lowered):
        return Phase.LEFT if age > settings.hold + _ROUNDING else Phase.DAMPED
    if phase is Phase.DAMPED and age > settings.hold + _ROUNDING:
        return Phase.LEFT
    if phase is Phase.DAMPED and not in_time:
        return phase
    if watch.followed:
        if age > settings.hold + _ROUNDING:
            return Phase.LOWERED
        return Phase.FOLLOWING if in_time else Phase.HOLDING
    if phase is Phase.STANDING:
        if not level:
            return Phase.LOWERED
        risen = elapsed >= settings.rising - _ROUNDING
        return Phase.FOLLOWING if risen and in_time else phase
    steady = now - watch.unsteady >= settings.recovery - _ROUNDING
    if not steady or not (lowered or phase is not Phase.LOWERED):
        return phase
    if level:
        return Phase.STANDING
    return Phase.LEFT if phase is Phase.LEFT else Phase.TIPPED


def between(begin: Array, end: Array, share: float) -> Array:
    """Goes from one pose to another, at rest at both ends."""
    return begin + eased(np.asarray(min(max(share, 0.0), 1.0))) * (end - begin)
