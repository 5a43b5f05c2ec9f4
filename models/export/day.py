"""The C of a robot's day: its modes, what leads from one to another, and where joints go."""

from dataclasses import dataclass

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.export.language import commented
from glassgait.models.export.reward_machine import Case, condition_lines, conjuncts, constants
from glassgait.models.robots.robot import Robot
from glassgait.models.robots.target_limits import TargetLimits
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.day import DAMP, POLICY, PROPOSITIONS, REQUESTS, Day
from glassgait.models.task.mode_machine import ModeMachine


@dataclass(frozen=True)
class ModeCode:
    """What a file holds of a mode.

    Attributes:
        title: Its name, as comments have it.
        constant: Name of the constant of its number, without what all names begin with.
        steps: Its seconds in control steps.
        acts: Whether the policy does.
        damps: Whether joints are damped alone.
        goal: Action that joints go to (12).
    """

    title: str
    constant: str
    steps: int
    acts: bool
    damps: bool
    goal: Array


@dataclass(frozen=True)
class DayCode:
    """What a file holds of a day.

    Attributes:
        digest: Of the day.
        modes: The modes, by number.
        initial: Constant of the first one.
        requests: What the operator may request, by number.
        propositions: What conditions are of.
        fault: The formula of the fault, the lines of its condition, and the constant of its mode.
        cases: What else leads from mode to mode.
        day: Its numbers.
        upright: Upward part of gravity's direction above which the trunk is leaning.
        level: Up to which it is level.
        halted: Idle control steps from which the robot is halted.
        blind: Unsound control steps beyond which it is blind.
    """

    digest: str
    modes: list[ModeCode]
    initial: str
    requests: tuple[str, ...]
    propositions: tuple[str, ...]
    fault: tuple[str, tuple[str, ...], str]
    cases: list[Case]
    day: Day
    upright: float
    level: float
    halted: int
    blind: int


def day_code(day: Day, robot: Robot, limits: TargetLimits | None) -> DayCode:
    """Writes a day.

    Raises:
        InputError: if nothing limits the policy's targets, or the robot's joints cannot take the
            day's postures.
    """
    if limits is None:
        raise InputError(
            "a day is exported with policies whose targets have limits, which come last; train "
            "one with them"
        )
    machine = ModeMachine(day, robot, limits)
    named = dict(zip(day.names, constants("MODE_", day.names), strict=True))
    modes = [
        ModeCode(
            commented(name),
            named[name],
            day.steps(name),
            mode.joints == POLICY,
            mode.joints == DAMP,
            goal,
        )
        for (name, mode), goal in zip(day.modes.items(), machine.goals, strict=True)
    ]
    cases = [
        Case(
            named[source],
            tuple(
                (commented(edge.when.text), _condition(edge.when.text), named[edge.target])
                for edge in day.edges
                if edge.source == source
            ),
        )
        for source, mode in day.modes.items()
        if mode.next
    ]
    fault = day.fault_formula.text
    return DayCode(
        digest=day.digest(),
        modes=modes,
        initial=named[day.initial],
        requests=REQUESTS,
        propositions=tuple(PROPOSITIONS.names),
        fault=(commented(fault), _condition(fault), named[day.damped]),
        cases=cases,
        day=day,
        upright=machine.upright,
        level=machine.level,
        halted=round(day.halt / CONTROL_PERIOD),
        blind=round(day.blindness / CONTROL_PERIOD),
    )


def _condition(formula: str) -> tuple[str, ...]:
    return condition_lines(conjuncts(formula, lambda name: f"now->{name}"))
