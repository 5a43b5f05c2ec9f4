"""What a controller has a robot do that has no watchdog: rise, test, follow, and damp for good.

A robot on Unitree's wire acts on the last LowCmd, whatever happened to the one that sent it. So the
controller's own end decides. Whatever is wrong, joints are damped: they brake, and the robot sinks
to the ground. From there only a person goes on, by starting the controller anew.

A controller with a day lets the robot rise by itself, and begins with one that lies. Then it is
followed at once, or after a self-test for which the robot rose and was lowered again. Where the day
damps, joints are commanded what they are where anything is wrong, but not for good.
"""

from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from annotated_types import Ge, Le

from glassgait.models.arrays import Array
from glassgait.models.link.motors import MotorCommand, damping
from glassgait.models.link.self_test import N_STEPS, self_test_targets
from glassgait.models.link.watchdog import CROUCH, Seconds, between
from glassgait.models.robots.robot import Robot
from glassgait.models.settings import Count, Settings
from glassgait.models.task import CONTROL_PERIOD

ROUNDING = 1e-6
"""A control step begins as if it had begun by this share of it before: ticks are whole."""


class Stage(IntEnum):
    """What the joints do."""

    WAITING = 0
    """Nothing was heard of the robot, and it is sent nothing."""
    RISING = 1
    """They go from where they were to the default stance."""
    TESTING = 2
    """They follow the targets of the self-test, by which the wiring is judged."""
    LOWERING = 3
    """They go from the default stance to the crouch, where a day begins."""
    FOLLOWING = 4
    """They follow the controller's targets."""
    DAMPED = 5
    """They brake, until a person starts anew."""


class Fault(StrEnum):
    """Why joints are damped."""

    ASKED = "L2 and B are held, on the remote or a gamepad"
    SILENT = "the robot is silent"
    LATE = "the controller itself was late"
    BAD_STATES = "too many states in a row have a wrong checksum or are not finite"
    LEANS = "the trunk leans too far"
    MISWIRED = "the self-test found the wiring otherwise than it is expected to be"
    BAD_TARGETS = "the controller's targets are not finite"
    ENDED = "the controller ends"


@dataclass(frozen=True)
class Supervision(Settings):
    """When a controller damps its robot, and how it lets it rise.

    Attributes:
        silence: Time without a state after which joints are damped (s), and time without a command
            of the controller's own after which they are.
        bad_states: How many states in a row may be bad before they are.
        lean: Greatest lean of the trunk (°).
        rising: Time in which the robot rises (s), and is lowered after the self-test of a
            controller with a day.
        self_test: Whether the robot moves each joint for two seconds, once it has risen, and is
            damped if what it measures is not what a simulation of it predicts.
        damping: Gain by which joints brake (N·m·s/rad).
    """

    title: ClassVar[str] = "supervision"

    silence: Seconds = 0.1
    bad_states: Count = 10
    lean: Annotated[float, Ge(1.0), Le(90.0)] = 45.0
    rising: Annotated[float, Ge(0.5), Le(60.0)] = 3.0
    self_test: bool = True
    damping: Annotated[float, Ge(0.1), Le(20.0)] = 5.0


class Course(NamedTuple):
    """What a supervisor remembers.

    Attributes:
        stage: What the joints do.
        since: When they began to, by the robot's clock (s).
        begin: Joint positions then (12; rad).
        fault: Why they are damped.
    """

    stage: Stage
    since: float
    begin: Array
    fault: Fault | None = None

    def passed(self, now: float, *, lies: bool = False) -> "Course":
        """Returns the course of a robot that has passed the self-test.

        Args:
            now: By the robot's clock (s).
            lies: Whether the controller begins with a robot that lies.
        """
        return self._replace(stage=Stage.LOWERING if lies else Stage.FOLLOWING, since=now)

    def damped(self, fault: Fault, now: float) -> "Course":
        """Returns the course of a robot that is damped, for the first reason there was."""
        if self.stage is Stage.DAMPED:
            return self
        return self._replace(stage=Stage.DAMPED, since=now, fault=fault)


def initial_course(robot: Robot) -> Course:
    """Returns the course before anything was heard."""
    return Course(Stage.WAITING, 0.0, robot.default_stance)


def step_course(
    course: Course,
    settings: Supervision,
    now: float,
    *,
    position: Array,
    lean: float,
    asked: bool,
    lies: bool = False,
) -> Course:
    """Decides by a state of the robot what its joints are to do.

    Args:
        course: The course before.
        settings: When to damp.
        now: Time of the state, by the robot's clock (s).
        position: Joint positions (12; rad).
        lean: Angle between the trunk's vertical axis and the world's (°).
        asked: Whether the operator asks to damp.
        lies: Whether the controller begins with a robot that lies.
    """
    if course.stage is Stage.WAITING:
        rises = settings.self_test or not lies
        course = Course(Stage.RISING if rises else Stage.FOLLOWING, now, position)
    if asked:
        return course.damped(Fault.ASKED, now)
    if not lean <= settings.lean:
        return course.damped(Fault.LEANS, now)
    if course.stage is Stage.RISING and now - course.since >= settings.rising:
        stage = Stage.TESTING if settings.self_test else Stage.FOLLOWING
        return course._replace(stage=stage, since=now)
    if course.stage is Stage.LOWERING and now - course.since >= settings.rising:
        return course._replace(stage=Stage.FOLLOWING, since=now)
    return course


def commanded(
    robot: Robot,
    course: Course,
    settings: Supervision,
    now: float,
    *,
    targets: Array,
    gains: tuple[float, float],
    damped: bool = False,
) -> MotorCommand:
    """Returns what joints are to do.

    Args:
        robot: The robot.
        course: Its course, beyond `WAITING`.
        settings: How it rises, and by what it is damped.
        now: Time, by the robot's clock (s).
        targets: The controller's joint targets, within the joints' ranges (12; rad).
        gains: Stiffness and damping of the joints (N·m/rad, N·m·s/rad).
        damped: Whether the controller asks for no stiffness in place of its targets.
    """
    match course.stage:
        case Stage.FOLLOWING if not damped:
            return MotorCommand.to(targets, gains)
        case Stage.TESTING:
            step = int((now - course.since) / CONTROL_PERIOD + ROUNDING)
            return MotorCommand.to(self_test_targets(robot)[min(step, N_STEPS - 1)], gains)
        case Stage.RISING | Stage.LOWERING:
            share, stance = (now - course.since) / settings.rising, robot.default_stance
            rises = course.stage is Stage.RISING
            pose = between(*(course.begin, stance) if rises else (stance, CROUCH), share)
            return MotorCommand.to(np.clip(pose, robot.lower_limits, robot.upper_limits), gains)
        case _:
            return damping(robot.default_stance, settings.damping)
