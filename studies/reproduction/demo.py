"""`glassgait demo`: one page with a robot that trots by formulas and a small distillation."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar

import pandas as pd
from pydrake.geometry import Meshcat

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.visualization import open_meshcat
from glassgait.models.policies.controller import alone
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.settings import Count, Settings, checked
from glassgait.models.task.gait import Gait, load_gait
from glassgait.studies.common.console import console, say
from glassgait.studies.common.figures import gait_figure, save_figure
from glassgait.studies.common.jobs import Workers
from glassgait.studies.common.policies import EXPERT, find_policies
from glassgait.studies.common.rollouts import RolloutConfig, play
from glassgait.studies.common.run import default_folder, open_run
from glassgait.studies.common.tables import print_table, write_table
from glassgait.studies.distillation.boosting import EbmSettings, HistogramGbmSettings
from glassgait.studies.distillation.config import DistillationConfig, StudentsSettings
from glassgait.studies.distillation.students import STUDENTS, load_students
from glassgait.studies.distillation.study import distill
from glassgait.studies.distillation.symbolic import SymbolicPerStateSettings, SymbolicSettings
from glassgait.studies.evaluation.alternation import alternation_report, alternation_scores
from glassgait.studies.evaluation.tables import TITLES, standalone_table
from glassgait.studies.importance.figures import contribution_figure
from glassgait.studies.reproduction.page import Section, write_page

SHOWN, FORMULAS = "formulas", "symbolic_per_state"
"""The shipped formulas that come first, and those that are distilled here."""

QUICK = DistillationConfig(
    students=(FORMULAS, "histogram_gbm", "ebm"),
    collector=FORMULAS,
    episodes=12,
    episode_steps=500,
    alone_rounds=2,
    alone_episodes=12,
    alone_steps=500,
    settings=StudentsSettings(
        **{
            "histogram_gbm": HistogramGbmSettings(n_trees=100),
            "ebm": EbmSettings(outer_bags=1, interactions=30),
            "symbolic": SymbolicSettings(shapes=((90, 90),), start_weights=(1,)),
            FORMULAS: SymbolicPerStateSettings(shapes=((90, 90),), start_weights=(1,)),
        }
    ),
)
"""Few samples, and students that take seconds to fit."""

FULL = replace(
    QUICK,
    students=tuple(name for name in STUDENTS if name != "gbm"),
    # One formula a joint strays further than other students that walk: its samples serve all.
    collector="symbolic",
    alone_episodes=4,
)
"""All kinds of students except exact trees, which are slow to fit."""

REPLAY_STEPS, REPLAYS_IN_A_ROW = 400, 450
"""An hour in all: a page that is opened late still moves."""

EXPLAINED_JOINT, EXPLAINED_STEP = 1, 200


@checked
class Demo(Settings):
    """Watch a robot trot by formulas, distil three students, and compare them.

    The page, runs/demo/report.html, first shows the formulas that ship: a replay, the gait diagram
    and the explanation of one action. It then compares students that are distilled from few
    samples, with one seed: `glassgait distill` and `evaluate` do more of everything.

    Attributes:
        full: Distil all kinds of students except exact GBM, and let each act in turns with the
            expert too.
        n_robots: Robots to evaluate with.
        robot: Name of a robot, or path of its robot.yaml; by default that of the policies that
            ship. Of another robot your own expert is taken.
        resume: Continue the run that the folder holds.
        output: Folder of the page; runs/demo by default.
    """

    title: ClassVar[str] = "demo"

    full: bool = False
    n_robots: Count = 26
    robot: str | None = None
    resume: bool = False
    output: Path | None = None

    def run(self) -> None:
        """Writes the page, again after each part."""
        started = time.monotonic()
        gait = load_gait(QUICK.gait)
        found = find_policies(gait, robot=self.robot)
        folder = self.output or default_folder(self.title, found.expert.robot.name)
        inputs = {"gait": gait.digest(), "expert": found.expert.digest()}
        run = {"study": self.title, "settings": self, "inputs": inputs, "resume": self.resume}
        with open_run(folder, **run), Workers().pool():
            page = _Page(gait, found.expert, folder)
            # Another robot may have no formulas yet.
            shown = SHOWN if SHOWN in found.students else EXPERT
            page.show(shown, found.students.get(shown, found.expert))
            trained = folder / "distillation"
            config = FULL if self.full else QUICK
            r2 = distill(config, gait, found.expert, trained, resume=self.resume)
            students = load_students(trained, found.expert)
            page.compare(students, r2, self.n_robots)
            if self.full:
                page.alternate(students, self.n_robots)
            minutes = (time.monotonic() - started) / 60
            path = page.write(f"Computed in {minutes:.1f} minutes.")
        console.print(f"page written to {path} after {minutes:.1f} minutes")


@dataclass
class _Page:
    """The page of one run so far: results in words, sections, and explanations after them."""

    gait: Gait
    expert: NeuralPolicy
    folder: Path
    results: list[str] = field(default_factory=list)
    sections: list[Section] = field(default_factory=list)
    explanations: list[Section] = field(default_factory=list)
    meshcat: Meshcat = field(default_factory=open_meshcat)

    def show(self, name: str, policy: Policy) -> None:
        """Adds a policy's replay and gait diagram, and of formulas the explanation of an action."""
        # The replay opens without a server; it is there before anything is distilled.
        title, file = f"{name}, as shipped", f"{name}_replay.html"
        rollout = play(
            self.gait,
            alone(policy, self.expert),
            Scenario(command=FixedCommand()),
            self.meshcat,
            self.folder / file,
            n_steps=REPLAY_STEPS,
            repetitions=REPLAYS_IN_A_ROW,
        )
        say(f"open {self.folder / file}: a replay, {title}")
        note = "Commanded 0.5 m/s forward, with sensor noise; the policy acts alone."
        self.sections.append(Section(title, note=note, replays=[(title, file)]))

        # The gait diagram, and of formulas the terms of one joint's target at one instant.
        caption = "Feet in contact over time, and the states of the reward machine"
        figures = {"gait": (caption, gait_figure(rollout, self.gait, title))}
        step, joint = min(EXPLAINED_STEP, len(rollout.time) - 1), EXPLAINED_JOINT
        if isinstance(policy, FormulaPolicy):
            written = f"{len(policy.to_file().written())} formulas of {policy.n_terms()} terms"
            self.results.append(f"A robot {self.gait.name}s by {written}, without a network.")
            parts = policy.explain(rollout["observation"][step], joint)
            moment = f"{quadruped.JOINTS[joint]} at {rollout.time[step]:.2f} s"
            caption = f"The terms of the formula that add up to the target of {moment}"
            figures["explanation"] = (caption, contribution_figure(parts, f"Terms of {moment}"))

        for stem, (_, figure) in figures.items():
            save_figure(figure, self.folder / f"{name}_{stem}", ("png",))
        saved = [(own, self.folder / f"{name}_{stem}.png") for stem, (own, _) in figures.items()]
        self.explanations.append(Section("How the policy acts", figures=saved, wide=True))
        self.write("This page is not complete: reload it for the next part.")

    def compare(self, students: Mapping[str, Policy], r2: pd.DataFrame, n_robots: int) -> None:
        """Rolls every student out without the expert, and adds one table of fit and scores."""
        say("rolling out every student alone")
        scores = self._roll_out(students, n_robots, (1, 0))
        table = standalone_table(scores, {EXPERT: self.expert, **students})
        fits = {row["student"]: row["r2"] for _, row in r2.iterrows()}
        table.insert(1, "R² held out", table["policy"].map(fits).round(3))
        write_table(table, self.folder / "standalone")
        print_table("Students without the expert", table)
        note = (
            "Forward speeds and yaw rates over the gait's whole range, with sensor noise; means "
            "with 95 % intervals over robots. A fall is any of the task's terminations."
        )
        best = table[1:].sort_values(TITLES["share"], na_position="first").iloc[-1]
        self.results.append(
            f"Of {len(students)} students that were distilled here, {best['policy']} keeps most of "
            f"the expert's return: {best[TITLES['share']]:.2f}."
        )
        self.sections.append(Section("Students distilled here", note=note, tables=[("", table)]))

    def alternate(self, students: Mapping[str, Policy], n_robots: int) -> None:
        """Lets the expert act at some of the steps, and adds the figure of returns."""
        say("rolling out every student in turns with the expert")
        scores = self._roll_out(students, n_robots, (1, 4, 0))
        policies = {EXPERT: self.expert, **students}
        alternation_report(scores, self.gait.name.capitalize(), policies).write(self.folder)
        note = "At ratio 1/4 the expert acts at every fourth step, at 0 never."
        caption = "Return, share of the expert's return and falls against the alternation ratio"
        figures = [(caption, self.folder / "return.png")]
        title = "Return against the alternation ratio"
        self.sections.append(Section(title, note=note, figures=figures))

    def _roll_out(
        self, students: Mapping[str, Policy], n_robots: int, periods: tuple[int, ...]
    ) -> pd.DataFrame:
        config = RolloutConfig(n_robots=n_robots, n_seeds=1, n_steps=500)
        kept = self.folder / "rollouts"
        return alternation_scores(self.gait, self.expert, students, config, kept, periods)

    def write(self, status: str) -> Path:
        """Writes the page so far, below a line about its state."""
        observed = len(self.expert.observation_names)
        taught = f"{self.gait.description} Expert: a network of {observed} observations."
        lead = [" ".join(self.results), f"{taught} {status}"]
        title = f"A {self.gait.name}ting robot, distilled into models a person can read"
        return write_page(self.folder, title, lead, [*self.sections, *self.explanations])
