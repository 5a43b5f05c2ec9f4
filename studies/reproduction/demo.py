"""`glassgait demo`: distils an expert quickly and writes a report that grows."""

import math
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np
import pandas as pd
from pydrake.geometry import Meshcat

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.rollout import Rollout
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.visualization import open_meshcat
from glassgait.models.formulas.text import write_formula
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_policy, policy_path
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import StatewiseSymbolicPolicy
from glassgait.models.robots import quadruped
from glassgait.models.settings import Count, Settings
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.alternation import ratio_title
from glassgait.models.task.gait import Gait, load_gait
from glassgait.studies.common.cases import PERIODS, alternation_cases, run_rollouts
from glassgait.studies.common.console import console, say
from glassgait.studies.common.figures import save_figure
from glassgait.studies.common.gait_figure import gait_figure, strip_data
from glassgait.studies.common.play import play
from glassgait.studies.common.policies import EXPERT, SHIPPED, find_policies
from glassgait.studies.common.rollouts import RolloutConfig
from glassgait.studies.common.run_folder import default_folder, open_run
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
from glassgait.studies.distillation.students.registry import STUDENTS, policy_title
from glassgait.studies.distillation.students.settings import StudentsSettings
from glassgait.studies.distillation.students.sparse_formula import SPARSE_FORMULA
from glassgait.studies.distillation.students.symbolic import STATEWISE_SYMBOLIC, SYMBOLIC
from glassgait.studies.distillation.students.symbolic_regression import (
    StatewiseSymbolicSettings,
    SymbolicSettings,
)
from glassgait.studies.distillation.study import distill, r2_table, write_r2_table
from glassgait.studies.evaluation.alternation import alternation_report, standalone_table
from glassgait.studies.reproduction.page import Page, Replay, Section, Table

SHOWN = STATEWISE_SYMBOLIC.name
"""The student that is distilled here whose formulas, replay and gait diagram are shown."""

PAGE = SPARSE_FORMULA.name
"""The student that ships and comes first: a whole controller on two pages."""

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

REPLAY_STEPS = 400
REPLAYS_IN_A_ROW = 450
"""An hour of them: a page that is opened early, or scrolled to late, shows a robot that trots."""

REPLAY_SPEED = 0.5
"""Commanded forward speed in replays (m/s)."""


@dataclass(frozen=True)
class Demo(Settings):
    """Distil the trot's expert quickly, compare, and write runs/demo/report.html.

    A replay of formulas that ship is there within a minute, and the report grows from then on. It
    lists what is smaller here than in `glassgait distill` and `glassgait evaluate scenarios`: fewer
    samples, which one student collects for all, smaller ensembles, robots of one seed, three
    alternation ratios. Students that do not collect have met none of their own mistakes, and
    intervals are wider.

    Attributes:
        n_robots: Robots to evaluate with.
        robot: Name of a robot, or path of its robot.yaml; by default that of the policies that
            ship. Of another robot your own expert is taken.
        resume: Continue the run that the folder holds.
        output: Folder of the report; runs/demo by default.
    """

    title: ClassVar[str] = "demo"

    n_robots: Count = 26
    robot: str | None = None
    resume: bool = False
    output: Path | None = None

    def run(self) -> None:
        """Runs the whole road."""
        started = time.monotonic()
        gait = load_gait(QUICK.gait)
        found = find_policies(gait, robot=self.robot)
        expert = found.expert
        folder = self.output or default_folder(self.title, expert.robot.name)
        replays: dict[str, tuple[str, Policy]] = {"expert": (policy_title(EXPERT), expert)}
        inputs = {"gait": gait.digest(), "expert": expert.digest()}
        if found.place == SHIPPED and PAGE in found.files:
            shipped = found.formulas(PAGE)
            replays = {"shipped": (f"{policy_title(PAGE)}, as shipped", shipped), **replays}
            inputs["shipped student"] = shipped.digest()
        run = {"study": self.title, "settings": self, "inputs": inputs, "resume": self.resume}
        with open_run(folder, **run):
            rollouts = RolloutConfig(n_robots=self.n_robots, n_seeds=1)
            parts = Parts(gait, expert, rollouts, n_replays=len(replays) + 1)
            road = _Road(parts, folder)
            for name, (title, policy) in replays.items():
                road.show(name, title, policy)
            road.distill(self.resume)
            road.evaluate()
            parts.minutes = (time.monotonic() - started) / 60
            path = demo_page(parts).write(folder)
        console.print(f"report written to {path} after {parts.minutes:.1f} minutes")


@dataclass
class Parts:
    """What the report shows: what is None or empty is not there yet.

    Attributes:
        gait: The gait.
        expert: The expert.
        rollouts: How robots are rolled out.
        n_replays: Number of replays in the end.
        replays: The replays so far, by their names.
        result: What the first one shows, in a sentence.
        r2: The R² table of the students so far.
        standalone: The scores alone.
        return_figure: Picture of return against alternation ratio.
        formulas: The formulas of the student that is shown, as `formula_texts` lists them.
        minutes: What the demo took; the page is complete with it.
    """

    gait: Gait
    expert: NeuralPolicy
    rollouts: RolloutConfig
    n_replays: int = 3
    replays: dict[str, Replay] = field(default_factory=dict)
    result: str = ""
    r2: pd.DataFrame | None = None
    standalone: pd.DataFrame | None = None
    return_figure: Path | None = None
    formulas: list[tuple[str, str]] = field(default_factory=list)
    minutes: float | None = None


@dataclass(frozen=True)
class _Road:
    """One run, part by part; each part leaves the report with what it made."""

    parts: Parts
    folder: Path
    meshcat: Meshcat = field(default_factory=open_meshcat)

    def show(self, name: str, title: str, policy: Policy) -> None:
        """Records a policy alone: a replay and a gait diagram, whose files begin with a name."""
        gait, expert = self.parts.gait, self.parts.expert
        replay = self.folder / replay_name(name)
        rollout = play(
            gait,
            alone(policy, expert),
            Scenario(command=FixedCommand(speed=REPLAY_SPEED)),
            self.meshcat,
            replay,
            n_steps=REPLAY_STEPS,
            repetitions=REPLAYS_IN_A_ROW,
        )
        say(f"open {replay}: a replay, {title}")
        figure = gait_figure(rollout, gait, f"{gait.name.capitalize()}, {title}")
        save_figure(figure, self.folder / f"{name}_gait")
        shown = Replay(title, replay_name(name), strip_data(rollout, gait))
        self.parts.replays[name] = shown
        self.parts.result = self.parts.result or result_in_words(title, rollout)
        self._write(f"replay, {title}")

    def distill(self, resume: bool) -> None:
        """Makes the students, and shows the formulas as soon as they are there."""
        folder, parts = self.folder / "distillation", self.parts

        def show_so_far(r2: pd.DataFrame) -> None:
            parts.r2 = r2_table(_in_usual_order(r2), parts.gait.name)
            if SHOWN in set(r2["student"]) and not parts.formulas:
                formulas = load_policy(policy_path(folder, SHOWN), parts.expert.robot)
                assert isinstance(formulas, StatewiseSymbolicPolicy)
                parts.formulas = formula_texts(parts.gait, formulas)
                self.show(SHOWN, f"{policy_title(SHOWN)}, distilled here", formulas)
            else:
                self._write(f"R² of {len(r2)} of {len(QUICK.students)} students")

        r2 = distill(
            QUICK, parts.gait, parts.expert, folder, say, resume=resume, finished=show_so_far
        )
        table = write_r2_table(_in_usual_order(r2), parts.gait.name, folder)
        print_table("R² on held-out data", table)

    def evaluate(self) -> None:
        """Rolls the students out alone, then with the expert between."""
        parts = self.parts
        students = load_students(self.folder / "distillation", parts.expert)
        say("rolling out every student alone")
        parts.standalone = standalone_table(self._roll_out(students, (1, 0)))
        print_table("Alone, without the expert", parts.standalone)
        self._write("scores alone")
        say("rolling out every student with the expert between")
        scores = self._roll_out(students, RATIO_PERIODS)
        alternation_report(scores, parts.gait.name.capitalize()).write(self.folder)
        parts.return_figure = self.folder / "return.png"

    def _roll_out(self, students: dict[str, Policy], periods: tuple[int, ...]) -> pd.DataFrame:
        parts = self.parts
        cases = alternation_cases(parts.gait, parts.expert, students, parts.rollouts, periods)
        return run_rollouts(cases, self.folder / "rollouts")

    def _write(self, new: str) -> None:
        path = demo_page(self.parts).write(self.folder)
        say(f"open {path}, or reload it: {new}")


def result_in_words(title: str, rollout: Rollout) -> str:
    """Says in a sentence how far a robot went, and whether it stayed up."""
    way = np.diff(rollout["state"][:, quadruped.POSITION][:, :2], axis=0)
    seconds = rollout.time[-1] - rollout.time[0]
    end = "fell at the end" if rollout.failed else "did not fall"
    return (
        f"{title}: this robot went {np.linalg.norm(way, axis=1).sum():.1f} m in {seconds:.0f} s, "
        f"commanded {REPLAY_SPEED:g} m/s, and {end}."
    )


def replay_name(name: str) -> str:
    """Returns the name of a replay's own page."""
    return f"{name}_replay.html"


def formula_texts(gait: Gait, student: StatewiseSymbolicPolicy) -> list[tuple[str, str]]:
    """Lists joint, state and length in nodes of every formula that is written, and its text."""
    return [
        (
            f"**{quadruped.JOINTS[joint]} in {gait.states[state]}**, {formula.length} nodes",
            write_formula(formula, student.vocabulary.symbols),
        )
        for (state, joint), formula in student.to_file().written().items()
    ]


def demo_page(parts: Parts) -> Page:
    """Makes the page of what there is by now."""
    smaller = Section(
        "What is smaller here, and what is lost",
        tables=[Table(reductions(QUICK, parts.rollouts, RATIO_PERIODS))],
    )
    summary = (
        f"{parts.gait.description} Neural expert, {len(parts.expert.observation_names)} "
        "observations, 12 joints."
    )
    result = f"**{parts.result}**" if parts.result else ""
    if parts.minutes is None:
        # It does not reload itself: the replays would begin anew each time.
        lead = [
            result or summary,
            *([summary] if result else []),
            "**This page is not complete: the demo is at work. Reload it now and then; each time "
            "there is more.** If the demo was interrupted, the same command with `--resume` "
            "completes it.",
        ]
    else:
        lead = [
            *([result] if result else []),
            f"{summary} Everything below was computed in {parts.minutes:.1f} minutes, and [some "
            f"of it is smaller](#{smaller.anchor}) than in the full studies.",
        ]
    return Page(
        f"A {parts.gait.name}ting robot, distilled into models a person can read",
        lead,
        [
            _replays(parts),
            _alone(parts),
            _alternation(parts),
            _r2(parts),
            smaller,
            _formulas(parts),
        ],
    )


def _replays(parts: Parts) -> Section:
    missing = parts.n_replays - len(parts.replays)
    return Section(
        "Replays",
        note=f"Commanded {REPLAY_SPEED} m/s forward, with sensor noise; each acts alone. "
        "Bars: feet in contact; bands: states of the reward machine, every second one hatched.",
        replays=list(parts.replays.values()),
        pending="further replays, of the expert and of the formulas that are distilled here"
        if missing
        else "",
    )


def _alone(parts: Parts) -> Section:
    title = "Alone, without the expert"
    if parts.standalone is None:
        pending = "how every student walks alone, after the last of them is fitted"
        return Section(title, pending=pending)
    note = (
        "Forward speeds and yaw rates over the gait's whole range, sensor noise on, 20 s; means "
        "with 95 % intervals over robots. A fall is any of the task's terminations. Errors are of "
        "1 s averages."
    )
    return Section(title, note=note, tables=[Table(parts.standalone)])


def _alternation(parts: Parts) -> Section:
    title = "Return against alternation ratio"
    if parts.return_figure is None:
        pending = "rollouts in which the expert and a student take turns, the last part of the demo"
        return Section(title, pending=pending)
    note = (
        "Ratio 1/n: the expert acts every n-th step, the student otherwise; 0 is the student "
        "alone. The dotted line is the expert alone. Shares compare robots under the same "
        "commands and noise."
    )
    caption = (
        "Return, share of the expert's return and falls of each student against the "
        "alternation ratio"
    )
    return Section(title, note=note, figures=[(caption, parts.return_figure)])


def _r2(parts: Parts) -> Section:
    title, n_students = "R² on held-out data", len(QUICK.students)
    if parts.r2 is None:
        return Section(title, pending=f"the first of {n_students} students is being distilled")
    missing = n_students - len(parts.r2)
    return Section(
        title,
        note="Mean over the twelve joints. The paper's column is its own robot, simulator and "
        "expert, with its shuffled split.",
        tables=[Table(parts.r2)],
        pending=f"{missing} of {n_students} students" if missing else "",
    )


def _formulas(parts: Parts) -> Section:
    title = "The policy in full: formulas per RM state, distilled here"
    if not parts.formulas:
        return Section(title, pending="the formulas")
    note = (
        "An action of 1 moves a joint's target by "
        f"{parts.expert.robot.action_scale:g} rad from the stance. *Late* goes from −1, as a state "
        "of the machine begins, to 1, late in it; *Lifted* from −1, where a foot is on the ground, "
        "to 1, where it is in the air. What is not listed is the mirror image of what is."
    )
    return Section(title, note=note, texts=parts.formulas)


def reductions(
    distillation: DistillationConfig, rollouts: RolloutConfig, periods: tuple[int, ...]
) -> pd.DataFrame:
    """Lists what is smaller than by default, in the order of the road, and what that costs."""
    full, usual = DistillationConfig(), RolloutConfig()
    left_out = [own.title for name, own in STUDENTS.items() if name not in distillation.students]
    collector, itself = distillation.collector, "each student its own"
    # Intervals shrink by the root of the number of robots.
    robots = [own.n_robots * own.n_seeds for own in (usual, rollouts)]
    wider = math.sqrt(robots[0] / robots[1])
    rows = [
        (
            "samples",
            _samples(full),
            _samples(distillation),
            "imitation and return: with more samples all students come closer to the expert",
        ),
        (
            "what collects them",
            itself,
            f"{STUDENTS[collector].title}, for all" if collector else itself,
            "a student that does not collect has met none of its own mistakes before it walks "
            "alone, and R² is of states that it may never visit",
        ),
        (
            "students",
            f"{len(STUDENTS)} kinds, formulas the best of several sizes",
            f"{len(distillation.students)} kinds, smaller ensembles, formulas of one size",
            f"{', '.join(left_out) or 'no kind'} is not compared; ensembles could do better",
        ),
        (
            "robots",
            _robots(usual),
            _robots(rollouts),
            f"intervals are {wider:.1f} times as wide; rare falls are missed",
        ),
        (
            "alternation ratios",
            ", ".join(map(ratio_title, PERIODS)),
            ", ".join(map(ratio_title, periods)),
            "the figure has fewer points between expert and alone",
        ),
    ]
    columns = ["", "by default, in distill and evaluate", "here", "what is lost"]
    return pd.DataFrame(rows, columns=pd.Index(columns))


def _samples(config: DistillationConfig) -> str:
    seconds = config.episode_steps * CONTROL_PERIOD
    return (
        f"{config.episodes} episodes of {seconds:g} s, then {config.alone_rounds} rounds in which "
        "the student acts alone"
    )


def _robots(config: RolloutConfig) -> str:
    seeds = "one seed" if config.n_seeds == 1 else f"each of {config.n_seeds} seeds"
    return f"{config.n_robots} of {seeds}, for {config.n_steps * CONTROL_PERIOD:g} s"


def _in_usual_order(r2: pd.DataFrame) -> pd.DataFrame:
    """Sorts students as all tables do, not as they were made."""
    return r2.sort_values("student", key=lambda names: names.map(list(STUDENTS).index))
