"""The studio without its page: a robot that walks, formulas that are edited, and what was found."""

import hashlib
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import chain, count
from pathlib import Path
from typing import Any

import numpy as np

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.scenario import Scenario, load_scenario, scenario_names
from glassgait.models.certificates.certificate import shipped_outcomes
from glassgait.models.errors import InputError, shown
from glassgait.models.files import read_text, write_atomically
from glassgait.models.formulas.file import FormulaFile
from glassgait.models.formulas.numbers import FileNumbers
from glassgait.models.policies.adjustable import AdjustablePolicy
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.task.command import gamepad_velocity
from glassgait.models.task.gait import Gait
from glassgait.studies.studio.background import Work, counted, proved
from glassgait.studies.studio.live_robot import LiveRobot
from glassgait.studies.studio.messages import (
    Act,
    Choose,
    Coefficient,
    Evaluate,
    Gamepad,
    Ghost,
    Message,
    Number,
    Push,
    Steer,
    Surroundings,
    Switch,
)
from glassgait.studies.studio.session import EditSession
from glassgait.studies.studio.terms import Term, TermReader

GAMEPAD_HOLDS = 0.5
"""Time after which robots stop that a gamepad commands, unless it does so again (s)."""

AT_REST = 0.4
"""Time after the last change of a number from which on the whole file is looked at (s)."""


class Studio:
    """Does what messages ask for. All but the robot is called from one thread.

    Attributes:
        gait: The gait.
        original: The controller as it was found, which the ghost acts by.
        robot: The robot that walks.
        session: The edits; none where the policy is not made of formulas.
    """

    def __init__(
        self,
        gait: Gait,
        controller: AlternatingController,
        scenario: Scenario,
        folder: Path,
        *,
        file: Path,
        seed: int = 0,
        drawn: bool = True,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """
        Args:
            gait: The gait.
            controller: A policy that acts alone.
            scenario: The scenario in which the robot begins, of a discrete plant.
            folder: Where files are saved.
            file: The policy's file.
            seed: Seed of noise and pushes.
            drawn: Whether robots show in Meshcat.
            clock: Gives the time (s), by which the file is at rest.

        Raises:
            InputError: if a policy does not fit.
        """
        self.gait, self.original, self.file, self._folder = gait, controller, file, folder
        self._clock, self._changed_at = clock, -math.inf
        self.notice: str | None = None
        self._gamepad_commands = False
        self.saved: Path | None = None
        self.verification: Work | None = None
        self.evaluation: Work | None = None
        self._baseline: dict[str, str] | None = None
        self._baseline_work: Work | None = None
        self.verified_digest: str | None = None
        self.evaluated_digest: str | None = None
        self.session: EditSession | None = None
        self.adjustable: AdjustablePolicy | None = None
        policy, acting = controller.policy, controller
        if isinstance(policy, FormulaPolicy):
            self.adjustable = AdjustablePolicy(policy)
            self.session = EditSession(self.adjustable.numbered, read_text(file, encoding="utf-8"))
            self.places = tuple(self.adjustable.numbered.formulas)
            self.reader = TermReader(self.adjustable, self.places[0])
            acting = _acting_by(controller, self.adjustable)
        self.robot = LiveRobot(gait, scenario, (acting, controller), drawn=drawn, seed=seed)

    def start(self) -> None:
        """Lets the robot walk."""
        self.robot.start()

    def stop(self) -> None:
        """Ends everything."""
        self.robot.stop()
        for work in (self.verification, self.evaluation, self._baseline_work):
            if work is not None:
                work.stop()

    def handle(self, message: Message) -> None:
        """Does what a message asks for.

        Raises:
            InputError: if it cannot be done.
        """
        if not isinstance(message, Gamepad):
            self.notice = None
        match message:
            case Steer(speed=speed, yaw_rate=yaw_rate, dwell=dwell):
                command = FixedCommand(speed, yaw_rate, round(dwell))
                command.check(self.gait)
                self.robot.steer(command)
            case Gamepad(axes=axes):
                self._steer_by(axes)
            case Push(angle=angle, speed=speed):
                turned = math.radians(angle)
                self.robot.push(speed * np.array([math.cos(turned), math.sin(turned), 0.0]))
            case Surroundings(slope=slope, latency=latency):
                self.robot.restart(self._in(slope, latency))
            case Ghost(walks=walks):
                self.robot.set_ghost(walks)
            case Act(what="pause" | "go" as what):
                self.robot.pause(what == "pause")
            case Act(what="step"):
                self.robot.step()
            case Act(what="restart"):
                self.robot.restart()
            case Act(what="halt work"):
                self._halt_work()
            case Evaluate(scenarios=scenarios):
                self._evaluate(scenarios)
            case Choose() | Coefficient() | Number() | Switch() | Act():
                self._edit(message, self._session())

    def look(self) -> None:
        """Takes what work in the background has found since."""
        for work in (self.verification, self.evaluation, self._baseline_work):
            if work is not None:
                work.look()
        done = self._baseline_work
        if done is not None and not done.runs:
            self._baseline_work = None
            if done.problem is None:
                self._baseline = {own["name"]: own["outcome"] for own in done.found}

    @property
    def is_at_rest(self) -> bool:
        """Whether no number has changed for a moment, so that the whole file may be looked at."""
        return self._clock() - self._changed_at >= AT_REST

    @cached_property
    def certified(self) -> Mapping[str, str] | None:
        """Outcomes by claim of the shipped certificate of the original file, if there is one."""
        return None if self.session is None else shipped_outcomes(self.original_digest)

    @cached_property
    def original_digest(self) -> str:
        """SHA-256 of the file that the session began with."""
        return hashlib.sha256(self._session().text.encode()).hexdigest()

    @property
    def baseline(self) -> Mapping[str, str] | None:
        """The outcome of each claim about the original, as far as it is known."""
        return self.certified or self._baseline

    def lost(self) -> tuple[str, ...]:
        """Returns the claims that were proved of the original and no longer are."""
        if self.verification is None or self.baseline is None:
            return ()
        return tuple(
            own["name"]
            for own in self.verification.found
            if self.baseline.get(own["name"]) == "proved" and own["outcome"] != "proved"
        )

    def numbered(self) -> FileNumbers:
        """Returns the file, and where its numbers stand."""
        return self._session().numbered

    def file_now(self) -> FormulaFile:
        """Returns the file with the numbers that count."""
        return self._session().file()

    def _steer_by(self, axes: Sequence[float]) -> None:
        """Commands what a gamepad does that is touched, and a stop once it no longer is."""
        dwell = self.robot.steering.dwell
        speed, yaw_rate = gamepad_velocity(self.gait, axes).tolist()
        touched = speed != 0.0 or yaw_rate != 0.0
        if touched or self._gamepad_commands:
            self.robot.steer(FixedCommand(speed, yaw_rate, dwell), lasts=GAMEPAD_HOLDS)
        self._gamepad_commands = touched

    def _session(self) -> EditSession:
        if self.session is None:
            kind = self.original.policy.kind
            raise InputError(f"the policy is of the kind {kind!r}, which has no formulas to edit")
        return self.session

    def _edit(self, message: Message, session: EditSession) -> None:
        match message:
            case Choose(place=place):
                self._choose(place)
                return
            case Act(what="save"):
                self._save(session)
                return
            case Act(what="verify"):
                self._verify(session)
                return
            case Coefficient(term=term, value=value, goes_on=goes_on):
                own = self._term(term)
                number = own.number_for(value, self._shown(own, session))
                if own.own is None or number is None:
                    raise InputError("this term shares its numbers with others; edit the file")
                session.change(own.own, number, goes_on=goes_on)
            case Number(index=index, value=value):
                session.change(index, value)
            case Switch(term=term, on=on):
                own = self._term(term)
                if own.own is None:
                    raise InputError("this term shares its numbers with others; edit the file")
                session.switch(own.own, on)
            case Act(what="undo"):
                session.undo()
            case Act(what="redo"):
                session.redo()
            case Act(what="reset"):
                session.reset()
        self._changed_at = self._clock()
        numbers, adjustable = session.numbers, self.adjustable
        assert adjustable is not None
        self.robot.ask(lambda: adjustable.adjust(numbers))

    def _shown(self, term: Term, session: EditSession) -> list[float]:
        numbers = list(session.numbers)
        for index in term.numbers:
            numbers[index] = session.shown(index)
        return numbers

    def coefficient(self, term: Term) -> float:
        """Returns the coefficient of a term, or what it was before it was switched off."""
        return term.coefficient(self._shown(term, self._session()))

    def _term(self, number: int) -> Term:
        if number >= len(self.reader.terms):
            raise InputError(f"term {number} is not in the formula; it has fewer")
        return self.reader.terms[number]

    def _choose(self, place: int) -> None:
        if place >= len(self.places):
            raise InputError(f"formula {place} is not in the file; it has {len(self.places)}")
        assert self.adjustable is not None
        self.reader = TermReader(self.adjustable, self.places[place])

    def _in(self, slope: float, latency: float) -> Scenario:
        """Returns the robot's scenario on another slope, with actions as late as asked."""
        scenario = self.robot.scenario
        terrain = replace(scenario.station.terrain, slope=slope)
        station = replace(scenario.station, terrain=terrain)
        step = station.time_step
        return replace(scenario, station=station, latency=round(latency / step) * step)

    def _verify(self, session: EditSession) -> None:
        if self.verification is not None:
            self.verification.stop()
        if self.baseline is None and self._baseline_work is None:
            self._baseline_work = Work(proved, self.original.policy, self.gait)
        self.verified_digest = session.digest()
        self.verification = Work(proved, self._policy(), self.gait)

    def _evaluate(self, scenarios: tuple[str, ...]) -> None:
        known = scenario_names()
        for name in scenarios:
            if name not in known:
                raise InputError(f"scenario {shown(name)} is none that ships; choose among them")
        if self.evaluation is not None:
            self.evaluation.stop()
        own = _acting_by(self.original, self._policy()) if self.session else self.original
        self.evaluated_digest = self.session.digest() if self.session else None
        self.evaluation = Work(counted, self.gait, (own, self.original), scenarios)

    def _halt_work(self) -> None:
        for work in (self.verification, self.evaluation, self._baseline_work):
            if work is not None:
                work.stop()
        self._baseline_work = None

    def _policy(self) -> FormulaPolicy:
        """Returns the policy of the session's numbers."""
        assert self.adjustable is not None
        return self.adjustable.to_policy(self._session().numbers)

    def _save(self, session: EditSession) -> None:
        self._folder.mkdir(parents=True, exist_ok=True)
        path = self.saved or self._free_path()
        write_atomically(path, session.written())
        self.saved = path
        self.notice = f"saved to {path}"

    def _free_path(self) -> Path:
        """Returns where no earlier session has saved."""
        stem = self._folder / f"{self.file.stem}_edited"
        names = chain([""], (f"_{number}" for number in count(2)))
        paths = (Path(f"{stem}{name}{FormulaPolicy.suffix}") for name in names)
        return next(path for path in paths if not path.exists())


def _acting_by(controller: AlternatingController, policy: Any) -> AlternatingController:
    """Returns the controller in which another policy acts in the place of the one that does."""
    if controller.student is None:
        return AlternatingController(policy)
    return replace(controller, student=policy)


def known_scenarios() -> dict[str, str]:
    """Returns the titles of the scenarios in which falls can be counted, by their names."""
    titles = {name: load_scenario(name) for name in scenario_names()}
    return {name: own.title for name, own in titles.items() if own.accuracy is None}
