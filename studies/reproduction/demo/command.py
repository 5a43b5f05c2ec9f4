"""`glassgait demo`: distils the shipped expert quickly and writes a report that grows."""

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import pandas as pd
from pydrake.geometry import Meshcat

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.visualization import open_meshcat
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import (
    load_expert,
    load_policy,
    load_student,
    policy_path,
)
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import StatewiseSymbolicPolicy
from glassgait.models.settings import Count, Settings
from glassgait.models.task.gait import Gait, load_gait
from glassgait.studies.common.cases import alternation_cases, run_rollouts
from glassgait.studies.common.console import console, say
from glassgait.studies.common.figures import save_figure
from glassgait.studies.common.gait_figure import gait_figure
from glassgait.studies.common.play import play
from glassgait.studies.common.rollouts import RolloutConfig
from glassgait.studies.common.run_folder import open_run
from glassgait.studies.common.tables import print_table
from glassgait.studies.distillation.config import DistillationConfig
from glassgait.studies.distillation.students.boosting import (
    EBM,
    GBM,
    HISTOGRAM_GBM,
    EbmSettings,
    HistogramGbmSettings,
)
from glassgait.studies.distillation.students.library import load_students
from glassgait.studies.distillation.students.registry import (
    STUDENTS,
    StudentsSettings,
    policy_title,
)
from glassgait.studies.distillation.students.symbolic import STATEWISE_SYMBOLIC, SYMBOLIC
from glassgait.studies.distillation.students.symbolic_regression import (
    StatewiseSymbolicSettings,
    SymbolicSettings,
)
from glassgait.studies.distillation.study import distill, r2_table, write_r2_table
from glassgait.studies.evaluation.alternation import alternation_report, standalone_table
from glassgait.studies.reproduction.demo.reductions import reductions
from glassgait.studies.reproduction.demo.report import Contents, Replay, formula_rows, write_report

SHOWN = STATEWISE_SYMBOLIC.name
"""The student whose formulas, replays and gait diagrams are shown."""

QUICK = DistillationConfig(
    # Formulas come first: the page shows them while the others are fitted.
    students=(SHOWN, *(name for name in STUDENTS if name not in (SHOWN, GBM.name))),
    # One formula a joint strays further than other students that walk: its samples serve them all,
    # while with those of formulas per RM state it fell in 4 of 26 rollouts itself.
    collector=SYMBOLIC.name,
    episodes=12,
    alone_rounds=2,
    alone_episodes=4,
    alone_steps=500,
    episode_steps=500,
    settings=StudentsSettings(
        **{
            HISTOGRAM_GBM.name: HistogramGbmSettings(n_trees=100),
            EBM.name: EbmSettings(outer_bags=1, interactions=30),
            SYMBOLIC.name: SymbolicSettings(shapes=((90, 90),), start_weights=(1,)),
            STATEWISE_SYMBOLIC.name: StatewiseSymbolicSettings(
                shapes=((90, 90),), start_weights=(1,)
            ),
        }
    ),
)
"""A quarter of the paper's samples, and students that take seconds to fit."""

RATIO_PERIODS = (1, 4, 0)
"""Control steps from one action of the expert to the next: ratios 1, 1/4 and 0."""

REPLAY_SECONDS = 8.0
REPLAYS_IN_A_ROW = 450
"""An hour of them: a page that is opened early, or scrolled to late, shows a robot that trots."""

REPLAY_SPEED = 0.5
"""Commanded forward speed in replays (m/s)."""


@dataclass(frozen=True)
class Demo(Settings):
    """Distil the shipped trot expert quickly, compare, and write runs/demo/report.html.

    A replay of formulas that ship is there within a minute, and the report grows from then on. It
    lists what is smaller here than in `glassgait distill` and `glassgait evaluate worlds`: fewer
    samples, which one student collects for all, smaller ensembles, robots of one seed, three
    alternation ratios. Students that do not collect have met none of their own mistakes, and
    intervals are wider.

    Attributes:
        output: Folder of the report.
        n_robots: Robots to evaluate with.
        resume: Continue the run that the folder holds.
    """

    title: ClassVar[str] = "demo"

    output: Path = Path("runs/demo")
    n_robots: Count = 26
    resume: bool = False

    def run(self) -> None:
        """Runs the whole road."""
        started = time.monotonic()
        gait = load_gait(QUICK.gait)
        expert = load_expert(gait.name)
        shipped = load_student(gait.name, SHOWN)
        shipped.check(gait=gait.name, observation_names=expert.observation_names)
        inputs = {
            "gait": gait.digest(),
            "expert": expert.digest(),
            "shipped student": shipped.digest(),
        }
        with open_run(self.output, study="demo", settings=self, inputs=inputs, resume=self.resume):
            road = _Road(gait, expert, self.output, self.n_robots)
            road.show(shipped, Replay("shipped", f"{policy_title(SHOWN)}, as shipped"))
            road.show(None, Replay("expert", policy_title("expert")))
            road.distill(self.resume)
            road.evaluate()
            road.finish((time.monotonic() - started) / 60)


@dataclass
class _Road:
    """One run, part by part; each part leaves the report with what it made."""

    gait: Gait
    expert: NeuralPolicy
    folder: Path
    n_robots: int
    rollouts: RolloutConfig = field(init=False)
    contents: Contents = field(init=False)
    meshcat: Meshcat = field(init=False)

    def __post_init__(self) -> None:
        self.rollouts = RolloutConfig(n_robots=self.n_robots, n_seeds=1)
        self.contents = Contents(
            self.gait,
            REPLAY_SPEED,
            n_observations=len(self.expert.observation_names),
            n_students=len(QUICK.students),
            reductions=reductions(QUICK, self.rollouts, RATIO_PERIODS),
        )
        self.meshcat = open_meshcat()

    def show(self, student: Policy | None, replay: Replay) -> None:
        """Records a student, or the expert, alone."""
        policy = alone(student or self.expert, self.expert)
        rollout = play(
            self.gait,
            policy,
            Scenario(command=FixedCommand(speed=REPLAY_SPEED)),
            self.meshcat,
            self.folder / replay.page,
            seconds=REPLAY_SECONDS,
            repetitions=REPLAYS_IN_A_ROW,
        )
        say(f"open {self.folder / replay.page}: a replay, {replay.title}")
        title = f"{self.gait.name.capitalize()}, {replay.title}"
        figure = gait_figure(rollout, self.gait, title)
        save_figure(figure, (self.folder / replay.figure).with_suffix(""))
        self.contents.replays.append(replay)
        self._write(f"replay, {replay.title}")

    def distill(self, resume: bool) -> None:
        """Makes the students, and shows the formulas as soon as they are there."""
        folder = self.folder / "distillation"

        def show_so_far(r2: pd.DataFrame) -> None:
            self.contents.r2 = r2_table(_in_usual_order(r2), self.gait.name)
            if SHOWN in set(r2["student"]) and not self.contents.formulas:
                formulas = load_policy(policy_path(folder, SHOWN))
                assert isinstance(formulas, StatewiseSymbolicPolicy)
                self.contents.formulas = formula_rows(self.gait, formulas)
                self.show(formulas, Replay(SHOWN, f"{policy_title(SHOWN)}, distilled here"))
            else:
                self._write(f"R² of {len(r2)} of {len(QUICK.students)} students")

        r2 = distill(
            QUICK, self.gait, self.expert, folder, say, resume=resume, finished=show_so_far
        )
        table = write_r2_table(_in_usual_order(r2), self.gait.name, folder)
        print_table("R² on held-out data", table)

    def evaluate(self) -> None:
        """Rolls the students out alone, then with the expert between."""
        students = load_students(self.folder / "distillation", self.expert)
        say("rolling out every student alone")
        self.contents.standalone = standalone_table(self._roll_out(students, (1, 0)))
        print_table("Alone, without the expert", self.contents.standalone)
        self._write("scores alone")
        say("rolling out every student with the expert between")
        scores = self._roll_out(students, RATIO_PERIODS)
        alternation_report(scores, self.gait.name.capitalize()).write(self.folder)
        self.contents.return_figure = self.folder / "return.png"

    def _roll_out(self, students: dict[str, Policy], periods: tuple[int, ...]) -> pd.DataFrame:
        jobs = alternation_cases(self.gait, self.expert, students, self.rollouts, periods)
        return run_rollouts(jobs, self.folder / "rollouts")

    def finish(self, minutes: float) -> None:
        """Writes the complete report."""
        self.contents.minutes = minutes
        path = write_report(self.folder, self.contents)
        console.print(f"report written to {path} after {minutes:.1f} minutes")

    def _write(self, new: str) -> None:
        path = write_report(self.folder, self.contents)
        say(f"open {path}, or reload it: {new}")


def _in_usual_order(r2: pd.DataFrame) -> pd.DataFrame:
    """Sorts students as all tables do, not as they were made."""
    return r2.sort_values("student", key=lambda names: names.map(list(STUDENTS).index))
