"""What becomes of robots whose messages are lost or late, counted in simulated time."""

import json
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import groupby, pairwise
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
import pandas as pd
from annotated_types import Ge, Lt
from pydrake.lcm import DrakeLcm

from glassgait.diagrams.acting import PolicyActing
from glassgait.diagrams.link import FOLLOWED, ControllerEnd, RobotEnd
from glassgait.diagrams.scenario import Scenario
from glassgait.models.link.channels import Channels
from glassgait.models.link.watchdog import Phase, Watchdog
from glassgait.models.policies.controller import Controller
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.settings import NotNegative, Settings
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait
from glassgait.studies.common.console import progress_bar
from glassgait.studies.common.episode import BoolArray
from glassgait.studies.common.tables import write_metrics

OVERTURNED = 60.0
"""Lean of the trunk beyond which a robot lies on its side or back (°)."""

TO_CONTROLLER, TO_ROBOT = 0, 1

COLUMNS = (
    "messages",
    "robots",
    "falls",
    "times lowered",
    "overturned",
    "risen",
    "kept down",
    "control steps",
    "answers",
    "late",
    "lost either way",
    "steps held (%)",
    "longest hold (s)",
)
"""Columns of the table, in order."""


@dataclass(frozen=True)
class Loss(Settings):
    """Which messages are lost.

    Attributes:
        share: Share of messages that are lost, each by itself.
        burst: Length of a time in which all are lost (s); 0 for none.
        interval: Time from the begin of a burst to the next (s).
    """

    title: ClassVar[str] = "loss"

    share: Annotated[float, Ge(0.0), Lt(1.0)] = 0.0
    burst: NotNegative = 0.0
    interval: Annotated[float, Ge(CONTROL_PERIOD)] = 10.0

    def draw(self, n_steps: int, n_channels: int, generator: np.random.Generator) -> BoolArray:
        """Draws which of the messages of each control step and channel are lost.

        Bursts take all channels at once; the first comes in the middle of the first interval, give
        or take a quarter of it.
        """
        lost = generator.uniform(size=(n_steps, n_channels)) < self.share
        if self.burst > 0.0:
            period = round(self.interval / CONTROL_PERIOD)
            starts = np.arange(0, n_steps, period)
            starts = starts + generator.integers(period // 4, 3 * period // 4 + 1, len(starts))
            step = np.arange(n_steps)[:, None]
            length = round(self.burst / CONTROL_PERIOD)
            lost |= np.any((step >= starts) & (step < starts + length), axis=1)[:, None]
        return lost


@dataclass(frozen=True)
class Trial:
    """What happens to the messages.

    Attributes:
        title: What tables call it.
        loss: Which of them are lost, either way.
        latency: Time from the sensors until their answer acts (s).
        silent: Times within a rollout between which there is no controller (s).
    """

    title: str
    loss: Loss = field(default_factory=Loss)
    latency: float = 0.01
    silent: tuple[float, float] = (0.0, 0.0)


TRIALS = (
    Trial("none lost, answers act at once", latency=0.0),
    Trial("none lost"),
    Trial("none lost, answers 20 ms late", latency=0.02),
    Trial("none lost, answers 30 ms late", latency=0.03),
    Trial("1 % lost", Loss(share=0.01)),
    Trial("5 % lost", Loss(share=0.05)),
    Trial("20 % lost", Loss(share=0.2)),
    Trial("all lost for 100 ms", Loss(burst=0.1)),
    Trial("all lost for 200 ms", Loss(burst=0.2)),
    Trial("all lost for 500 ms", Loss(burst=0.5)),
    Trial("controller gone after 5 s, back after 10 s", silent=(5.0, 10.0)),
)
"""Where no latency is given, answers act 10 ms after their sensors, at the plant's next step."""


def lose_packets(
    gait: Gait,
    controller: Controller,
    scenario: Scenario,
    folder: Path,
    *,
    n_robots: int,
    n_steps: int,
    watchdog: Watchdog,
    seed: int,
) -> pd.DataFrame:
    """Lets robots walk through every trial.

    Args:
        gait: The gait.
        controller: The controller.
        scenario: The world.
        folder: Where each trial is kept; one that is there is not done again.
        n_robots: Robots of each trial.
        n_steps: Control steps of each robot.
        watchdog: How long robots wait for their controller.
        seed: Seed of commands, noise and losses.

    Returns:
        A row a trial, with columns `COLUMNS`.
    """
    rows = []
    with progress_bar(len(TRIALS)) as (progress, task):
        for number, trial in enumerate(TRIALS):
            progress.update(task, text=trial.title)
            done = folder / f"{number}.json"
            if not done.exists():
                robots = LossyRobots(
                    gait, controller, scenario, trial, watchdog=watchdog, seed=seed
                )
                write_metrics(robots.walk(n_robots, n_steps), done)
            rows.append(json.loads(done.read_text()))
            progress.advance(task)
    return pd.DataFrame(rows, columns=pd.Index(COLUMNS))


class LossyLink:
    """Carries messages from one end to the other, in one process, as far as they are not lost."""

    def __init__(self, channels: Channels) -> None:
        self.robot, self.controller = DrakeLcm("memq://"), DrakeLcm("memq://")
        self._channels = channels
        self._lost: BoolArray = np.zeros(2, dtype=bool)
        self._answers: deque[tuple[int, bytes]] = deque()
        self._due = 0
        for channel in (channels.sensors, channels.command):
            self.robot.Subscribe(channel, self._to_controller(channel))
        self.controller.Subscribe(channels.targets, self._take_answer)

    def begin_step(self, lost: BoolArray, due: int) -> None:
        """Sets what becomes of a control step's messages."""
        self._lost, self._due = lost, due

    def deliver(self, now: int) -> None:
        """Gives the robot the answers that are due (steps of the plant)."""
        while self._answers and self._answers[0][0] <= now:
            self.robot.Publish(self._channels.targets, self._answers.popleft()[1])

    def _to_controller(self, channel: str):
        def carry(data: bytes) -> None:
            if not self._lost[TO_CONTROLLER]:
                self.controller.Publish(channel, data)

        return carry

    def _take_answer(self, data: bytes) -> None:
        if not self._lost[TO_ROBOT]:
            self._answers.append((self._due, data))


class LossyRobots:
    """Lets robots walk one after the other, whose messages are lost as a trial says."""

    def __init__(
        self,
        gait: Gait,
        policy: Controller,
        scenario: Scenario,
        trial: Trial,
        *,
        watchdog: Watchdog,
        seed: int,
    ) -> None:
        """
        Raises:
            InputError: if the scenario is not made for two processes, or the gait not for it.
        """
        channels = Channels()
        self._link, self._trial = LossyLink(channels), trial
        self._robot = RobotEnd(
            gait, scenario, self._link.robot, channels, watchdog=watchdog, session=1, seed=seed
        )
        self._controller = ControllerEnd(
            PolicyActing(policy.robot, gait, policy), self._link.controller, channels
        )
        self._generator = np.random.default_rng(seed)
        self._late = round(trial.latency / CONTROL_PERIOD * self._robot.n_parts)

    def walk(self, n_robots: int, n_steps: int) -> dict[str, Any]:
        """Lets robots walk, each until it falls or its steps are taken; returns a row."""
        outcomes = [self._walk_one(n_steps) for _ in range(n_robots)]
        phases = [phase for one in outcomes for phase in one.phases]
        steps, tally = len(phases), self._robot.tally
        changes = [
            after for one in outcomes for before, after in pairwise(one.phases) if before != after
        ]
        row = (
            self._trial.title,
            n_robots,
            sum(one.fell for one in outcomes),
            changes.count(Phase.LOWERED),
            sum(one.overturned for one in outcomes),
            changes.count(Phase.STANDING),
            changes.count(Phase.TIPPED),
            steps,
            tally.heard,
            tally.late,
            self._controller.tally.lost + tally.lost,
            100.0 * phases.count(Phase.HOLDING) / steps,
            CONTROL_PERIOD * _longest(phases, Phase.HOLDING),
        )
        return dict(zip(COLUMNS, row, strict=True))

    def _walk_one(self, n_steps: int) -> "Outcome":
        robot, outcome = self._robot, Outcome()
        robot.put_back()
        lost = self._trial.loss.draw(n_steps, 2, self._generator)
        first, last = (round(time / CONTROL_PERIOD) for time in self._trial.silent)
        for step in range(n_steps):
            self._take_step(lost[step], silent=first <= step < last)
            outcome.phases.append(robot.phase)
            outcome.fell = robot.fallen
            if robot.phase not in FOLLOWED:
                lean = kinematics.lean(robot.output("state")[quadruped.QUATERNION])
                outcome.overturned |= bool(lean > OVERTURNED)
            if outcome.fell:
                break
        return outcome

    def _take_step(self, lost: BoolArray, *, silent: bool) -> None:
        robot, link = self._robot, self._link
        now = robot.step * robot.n_parts
        link.begin_step(lost | silent, now + self._late)
        robot.send()
        link.robot.HandleSubscriptions(0)
        link.controller.HandleSubscriptions(0)
        self._controller.answer()
        link.controller.HandleSubscriptions(0)
        for part in range(robot.n_parts):
            link.deliver(now + part)
            robot.advance(part)


@dataclass
class Outcome:
    """What became of one robot.

    Attributes:
        phases: What its joints did after each control step.
        fell: Whether it fell while it followed its controller.
        overturned: Whether it fell over while it did not.
    """

    phases: list[Phase] = field(default_factory=list)
    fell: bool = False
    overturned: bool = False


def _longest(phases: Sequence[Phase], sought: Phase) -> int:
    return max((len(list(run)) for phase, run in groupby(phases) if phase is sought), default=0)
