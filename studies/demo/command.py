"""`glassgait demo`: distils the shipped expert quickly and writes a report."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.visualization import open_meshcat
from glassgait.models.policies.alternating import AlternatingPolicy
from glassgait.models.policies.library import load_expert
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.settings import Count, Settings
from glassgait.models.task.gait import Gait, load_gait
from glassgait.studies.console import console, say
from glassgait.studies.demo.report import write_report
from glassgait.studies.distillation.config import DistillationConfig
from glassgait.studies.distillation.study import distill
from glassgait.studies.distillation.tables import write_r2_table
from glassgait.studies.evaluation.alternation import alternation_jobs
from glassgait.studies.evaluation.results import write_alternation
from glassgait.studies.evaluation.tables import policy_title
from glassgait.studies.figures import save_figure
from glassgait.studies.rollouts.config import RolloutConfig
from glassgait.studies.rollouts.gait_figure import gait_figure
from glassgait.studies.rollouts.jobs import run_jobs
from glassgait.studies.rollouts.play import play
from glassgait.studies.run_folder import open_run
from glassgait.studies.students.additive import EBM, EbmSettings
from glassgait.studies.students.boosting import GBM, HISTOGRAM_GBM, HistogramGbmSettings
from glassgait.studies.students.library import load_students
from glassgait.studies.students.registry import STUDENTS
from glassgait.studies.students.settings import StudentsSettings
from glassgait.studies.students.symbolic import STATEWISE_SYMBOLIC, SYMBOLIC
from glassgait.studies.students.symbolic_settings import StatewiseSymbolicSettings, SymbolicSettings
from glassgait.studies.tables import print_table

QUICK = DistillationConfig(
    students=tuple(name for name in STUDENTS if name != GBM.name),
    episodes=12,
    alone_rounds=2,
    alone_episodes=4,
    alone_steps=500,
    episode_steps=500,
    settings=StudentsSettings(
        **{
            HISTOGRAM_GBM.name: HistogramGbmSettings(n_trees=100),
            EBM.name: EbmSettings(outer_bags=1, interactions=30, max_rounds=500),
            SYMBOLIC.name: SymbolicSettings(shapes=((90, 90),), start_weights=(1,)),
            STATEWISE_SYMBOLIC.name: StatewiseSymbolicSettings(
                shapes=((90, 90),), start_weights=(1,)
            ),
        }
    ),
)
"""A quarter of the paper's samples, and students that take seconds to fit."""

REPLAY_SECONDS = 8.0
SHOWN = STATEWISE_SYMBOLIC.name
"""The student whose formulas, replay and gait diagram are shown."""


@dataclass(frozen=True)
class Demo(Settings):
    """Distil the shipped trot expert quickly, compare, and write runs/demo/report.html.

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
        inputs = {"gait": gait.digest(), "expert": expert.digest()}
        with open_run(self.output, study="demo", settings=self, inputs=inputs, resume=self.resume):
            self._run(gait, expert, started)

    def _run(self, gait: Gait, expert: NeuralPolicy, started: float) -> None:
        folder = self.output
        distillation = folder / "distillation"
        r2 = distill(QUICK, gait, expert, distillation, say, resume=self.resume)
        r2_summary = write_r2_table(r2, gait.name, distillation)
        print_table("R² on held-out data", r2_summary)

        students = load_students(distillation, expert)
        config = RolloutConfig(n_robots=self.n_robots, n_seeds=1)
        say("rolling out every student at every alternation ratio")
        jobs = alternation_jobs(gait, expert, students, config)
        scores = run_jobs(jobs, folder / "rollouts")
        standalone = write_alternation(scores, "Trot", folder)
        print_table("Alone, without the expert", standalone)

        for name, student in (("expert", None), (SHOWN, students[SHOWN])):
            say(f"recording the {name}")
            policy = AlternatingPolicy(expert, student, period=1 if student is None else 0)
            rollout = play(
                gait,
                policy,
                Scenario(command=FixedCommand(speed=0.5)),
                open_meshcat(),
                folder / f"{name}_replay.html",
                seconds=REPLAY_SECONDS,
            )
            title = f"Trot, {policy_title(name)}"
            save_figure(gait_figure(rollout, gait, title), folder / f"{name}_gait")
        minutes = (time.monotonic() - started) / 60
        write_report(
            folder,
            gait=gait,
            expert=expert,
            shown=(SHOWN, students[SHOWN]),
            r2=r2_summary,
            standalone=standalone,
            minutes=minutes,
        )
        console.print(f"report written to {folder / 'report.html'} after {minutes:.1f} minutes")
