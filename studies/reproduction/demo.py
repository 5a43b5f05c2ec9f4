"""`glassgait demo`: one page with a robot that trots by formulas and a small distillation."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import pandas as pd
from pydrake.geometry import Meshcat

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.visualization import open_meshcat
from glassgait.models.policies.controller import alone
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
from glassgait.studies.distillation.students import load_students
from glassgait.studies.distillation.study import distill
from glassgait.studies.distillation.symbolic import SymbolicPerStateSettings
from glassgait.studies.evaluation.alternation import alternation_scores
from glassgait.studies.evaluation.tables import TITLES, standalone_table
from glassgait.studies.importance.figures import contribution_figure
from glassgait.studies.reproduction.page import Section, write_page

SHOWN, FORMULAS = "formulas", "symbolic_per_state"
"""Kinds of the shipped formulas that the page shows first, and of the distilled formulas."""

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
            FORMULAS: SymbolicPerStateSettings(shapes=((90, 90),), start_weights=(1,)),
        }
    ),
)
"""Few samples, and students that take seconds to fit."""

REPLAY_STEPS, REPLAYS_IN_A_ROW = 400, 450
"""The replay lasts an hour in total, so that a page that is opened late still moves."""

EXPLAINED_JOINT, EXPLAINED_STEP = 1, 200


@checked
class Demo(Settings):
    """Watch a robot trot by formulas, distil three students, and compare them.

    The page, runs/demo/report.html, first shows the formulas that ship: a replay, the gait diagram
    and the explanation of one action. It then compares students that are distilled from few
    samples with one seed; `glassgait distill` and `evaluate` use more samples, robots and seeds.

    Attributes:
        n_robots: Number of robots in the evaluation.
        robot: Name of a robot, or path of its robot.yaml; by default the robot of the policies that
            ship. For other robots, your expert in runs/train is used.
        resume: Continue the run that the folder holds.
        output: Folder of the page; runs/demo by default.
    """

    title: ClassVar[str] = "demo"

    n_robots: Count = 26
    robot: str | None = None
    resume: bool = False
    output: Path | None = None

    def run(self) -> None:
        """Writes the page, and writes it again after each part."""
        started = time.monotonic()
        gait = load_gait(QUICK.gait)
        policies = find_policies(gait, robot=self.robot)
        expert = policies.expert
        folder = self.output or default_folder(self.title, expert.robot.name)
        inputs = {"gait": gait.digest(), "expert": expert.digest()}
        run = {"study": self.title, "settings": self, "inputs": inputs, "resume": self.resume}
        with open_run(folder, **run), Workers().pool():
            page = _Page(gait, expert, folder)
            # Another robot may have no formulas yet.
            shown = SHOWN if SHOWN in policies.students else EXPERT
            page.show(shown, policies.students.get(shown, expert))
            distillation = folder / "distillation"
            r2 = distill(QUICK, gait, expert, distillation, resume=self.resume)
            students = load_students(distillation, expert)
            page.compare(students, r2, self.n_robots)
            minutes = (time.monotonic() - started) / 60
            path = page.write(f"Computed in {minutes:.1f} minutes.")
        console.print(f"page written to {path} after {minutes:.1f} minutes")


@dataclass
class _Page:
    """The page of one run: sentences of results, sections, and explanations after them."""

    gait: Gait
    expert: Policy
    folder: Path
    results: list[str] = field(default_factory=list)
    sections: list[Section] = field(default_factory=list)
    explanations: list[Section] = field(default_factory=list)
    meshcat: Meshcat = field(default_factory=open_meshcat)

    def show(self, name: str, policy: Policy) -> None:
        """Adds a policy's replay and gait diagram and, for formulas, the terms of a target."""
        # Write the replay, which opens without a server, before the distillation.
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
        note = "Commanded 0.5 m/s forward, with sensor noise; the policy acts without the expert."
        self.sections.append(Section(title, note=note, replays=[(title, file)]))

        # Draw the gait diagram and, for formulas, the terms of one joint's target at one instant.
        caption = "Feet in contact over time, and the states of the reward machine"
        figures = {"gait": (caption, gait_figure(rollout, self.gait, title))}
        step, joint = min(EXPLAINED_STEP, len(rollout.time) - 1), EXPLAINED_JOINT
        if isinstance(policy, FormulaPolicy):
            written = f"{len(policy.to_file().written())} formulas of {policy.n_terms()} terms"
            self.results.append(f"A robot {self.gait.name}s by {written}, without a network.")
            terms = policy.explain(rollout["observation"][step], joint)
            moment = f"{quadruped.JOINTS[joint]} at {rollout.time[step]:.2f} s"
            caption = f"The terms of the formula that add up to the target of {moment}"
            figures["explanation"] = (caption, contribution_figure(terms, f"Terms of {moment}"))

        for stem, (_, figure) in figures.items():
            save_figure(figure, self.folder / f"{name}_{stem}", ("png",))
        saved = [(text, self.folder / f"{name}_{stem}.png") for stem, (text, _) in figures.items()]
        self.explanations.append(Section("How the policy acts", figures=saved, wide=True))
        self.write("This page is not complete: reload it for the next part.")

    def compare(self, students: Mapping[str, Policy], r2: pd.DataFrame, n_robots: int) -> None:
        """Rolls out every student without the expert, and adds a table of R² and scores."""
        say("rolling out every student without the expert")
        config = RolloutConfig(n_robots=n_robots, n_seeds=1, n_steps=500)
        folder = self.folder / "rollouts"
        scores = alternation_scores(self.gait, self.expert, students, config, folder, (1, 0))
        table = standalone_table(scores, {EXPERT: self.expert, **students})
        fits = {row["student"]: row["r2"] for _, row in r2.iterrows()}
        table.insert(1, "R² held out", table["policy"].map(fits).round(3))
        write_table(table, self.folder / "standalone")
        print_table("Students without the expert", table)
        note = (
            "Commands cover the gait's whole range, and there is sensor noise. Means are over "
            "robots, with 95 % intervals. A fall is any of the task's terminations."
        )
        best = table[1:].sort_values(TITLES["share"], na_position="first").iloc[-1]
        self.results.append(
            f"Of the {len(students)} students distilled here, {best['policy']} has the greatest "
            f"share of the expert's return: {best[TITLES['share']]:.2f}."
        )
        self.sections.append(Section("Students distilled here", note=note, tables=[("", table)]))

    def write(self, status: str) -> Path:
        """Writes the page so far, with its status."""
        n = len(self.expert.observation_names)
        setup = f"{self.gait.description} The expert is a network of {n} observations."
        lead = [" ".join(self.results), f"{setup} {status}"]
        title = f"A {self.gait.name}ting robot, distilled into models a person can read"
        return write_page(self.folder, title, lead, [*self.sections, *self.explanations])
