"""The report's contents: each of the paper's tables and figures, and ours for it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from glassgait.models.robots.robot import Robot
from glassgait.studies.distillation.students.boosting import EBM, GBM
from glassgait.studies.distillation.students.registry import STUDENTS, paper_students, student_title
from glassgait.studies.reproduction.gait import GaitResults
from glassgait.studies.reproduction.page import Section, Table

FRAMEWORK = Path(__file__).parents[1] / "pictures" / "locomotion.svg"

DEVIATIONS = (
    "Experts are trained with 256 robots for 17 to 32 % of the paper's control steps, "
    "with a curriculum on the reward machine that the paper does not have.",
    "GBM (boosted trees) has more and deeper trees than scikit-learn's defaults, each fitted to a "
    "quarter of the samples; explainable boosting takes larger and fewer steps than interpret's "
    "defaults, with fewer bins and bags. While samples are collected trees are boosted by "
    "histograms and additive models are smaller.",
    "Formulas start from a sparse sum found by least squares, gated by the reward machine and by "
    "which feet are in the air, which Operon may then correct. Of several shapes, with the samples "
    "of an episode's start counting once or often, the simplest is taken that walks alone about as "
    "well as the best. The paper evolves them with PySR alone. "
    "A joint's formula has at most 90 nodes, as the paper's, one per RM state at most 400, but "
    "Operon counts a weighted observation as one.",
    "After the paper's episodes come rounds in which the student acts alone.",
    "Students are refitted when the alternation ratio changes, not after every episode.",
    "R² is given for whole episodes held out beside the paper's split, which shuffles steps.",
    "Gait sequences are drawn as contacts over time, not as stills; glassgait view draws "
    "those, with --stills.",
    "Importances of legs are merged by a stated rule: added up over observations that differ by "
    "leg alone; each of a type's four joints names its own first, second and third.",
)
"""What a report of experts that are there does otherwise than the paper."""

DEVIATIONS_IN_FULL = (
    "Friction differs between 16 groups of robots while experts learn, not between all robots.",
    "In distillation and rollouts an episode ends where the trunk is below 0.20 m or an action "
    "changes by more than 60 squared; while experts learn, at the reference code's 0.25 m and 40.",
    "The walk is asked for at most 0.5 m/s, so its episodes of 0.75 m/s ask for 0.5.",
    "A robot that falls while samples are collected starts again, and its episode goes on.",
    "Students that act are fitted to four of five episodes, whole ones; R² by the paper's split, "
    "which shuffles steps, is of another fit to the same episodes.",
    "While n is 1 the expert acts at every step, so students are first fitted after that.",
    "Explainable boosting takes the machine's state, which is 0 or 1, for a number. Trees and "
    "tables are rounded to single precision, numbers in formulas to three digits.",
    "Gait sequences are drawn as contacts over time, not as stills.",
)
"""What a report whose experts are trained does otherwise than the paper, by any settings."""

WITHOUT_PYSR = (
    "Formulas are searched by Operon, not by PySR: operators, nodes and iterations are counted "
    "otherwise, there is no cube, and what a function is applied to has no bound of its own. Their "
    "numbers are not the paper's method's."
)


def deviations(robot: Robot, *, trains: bool) -> tuple[str, ...]:
    """Lists what a report does otherwise than the paper, by any settings."""
    if trains:
        return (
            f"The robot is a {robot.full_name} in Drake, SAP contact at 10 ms, on flat ground; the "
            "paper's stands in IsaacGym. What else differs in robot and task is listed in "
            "studies/training/README.md.",
            *DEVIATIONS_IN_FULL,
        )
    return (
        f"The robot is a {robot.full_name} in Drake, SAP contact at 10 ms; the paper names neither "
        "its simulator's contact model nor its time step.",
        *DEVIATIONS,
    )


@dataclass(frozen=True)
class _Figure:
    """A figure of every gait.

    Attributes:
        number: The paper's number for it.
        title: What it shows.
        files: Its pictures in a gait's folder, each with what it shows.
        first: The gait that the paper shows; it comes first.
        note: How to read it.
        wide: Whether a picture takes the page's whole width.
    """

    number: str
    title: str
    files: Mapping[str, str]
    first: str = ""
    note: str = ""
    wide: bool = True

    def section(self, results: Sequence[GaitResults]) -> Section:
        """Returns it as a section."""
        ordered = sorted(results, key=lambda own: own.gait != self.first) if self.first else results
        figures = [
            (f"{own.gait.capitalize()}: {what}", own.folder / f"{stem}.png")
            for stem, what in self.files.items()
            for own in ordered
        ]
        return Section(self.title, self.number, self.note, figures=figures, wide=self.wide)


ONE_JOINT = (
    _Figure(
        "Figure 6",
        "A weak learner of the GBM, FL hip",
        {f"{GBM.name}_FL_hip_tree": "decision tree"},
        first="walk",
    ),
    _Figure(
        "Figure 7",
        "Partial dependence on the top 3 observations, GBM, FL hip",
        {f"{GBM.name}_FL_hip_partial_dependence": "dependence"},
        first="walk",
    ),
    _Figure(
        "Figure 8, top",
        "Functions of one observation, explainable boosting, FL hip",
        {f"{EBM.name}_FL_hip_shapes": "shapes"},
        first="trot",
        note="Bands of two standard deviations between bags, where there is more than one.",
    ),
    _Figure(
        "Figure 8, bottom",
        "A function of two observations, explainable boosting, FL hip",
        {f"{EBM.name}_FL_hip_pair_1": "pair"},
        first="trot",
        wide=False,
    ),
    _Figure(
        "Figure 9",
        "Local explanation, explainable boosting, FL hip",
        {f"{EBM.name}_local": "local explanation"},
        first="pace",
        wide=False,
    ),
    _Figure(
        "Figure 10",
        "Global importances of the terms, explainable boosting, FL hip",
        {f"{EBM.name}_FL_hip_terms": "importances of terms"},
        wide=False,
    ),
    _Figure(
        "Figure 11",
        "Observation importances of the GBM, by two methods",
        {
            f"{GBM.name}_impurity": "impurity importance",
            f"{GBM.name}_permutation": "permutation importance",
        },
    ),
)
"""Figures of one student and mostly one joint."""


def contents(results: Sequence[GaitResults]) -> list[Section]:
    """Lists everything in the paper's order, then the gait sequences of further students."""
    further = [kind for kind in _students(results) if kind not in paper_students()]
    papers = dict(zip(("Figure 3", "Figure 4", "Figure 5"), paper_students(), strict=True))
    ours = {f"Ours {place}": kind for place, kind in enumerate(further, start=1)}
    return [
        Section(
            "The framework, as the Drake diagram that runs it",
            "Figure 1",
            "Expert and student sit behind one switch; the alternation chooses which of them acts.",
            figures=[("Block diagram of the closed loop", FRAMEWORK)],
            wide=True,
        ),
        *_tables(results),
        *(_sequences(number, kind).section(results) for number, kind in papers.items()),
        *(figure.section(results) for figure in ONE_JOINT),
        *(_sequences(number, kind).section(results) for number, kind in ours.items()),
    ]


def _tables(results: Sequence[GaitResults]) -> list[Section]:
    ratios = _Figure("Figure 2", "", {"return": "return against ratio"}).section(results)
    return [
        Section(
            "Top 3 observations by importance for each joint type, GBM (boosted trees)",
            "Table I",
            "An asterisk marks what the paper lists at the same place.",
            tables=[
                Table(_tops(results, "impurity"), "Feature importance (impurity)"),
                Table(_tops(results, "permutation"), "Permutation importance"),
            ],
        ),
        Section(
            "R² on test sets",
            "Table II",
            "Ours by the paper's shuffled split, the paper's beside it, and ours with whole "
            "episodes held out.",
            tables=[Table(r2_by_gait(results))],
        ),
        Section(
            "Return and falls against the alternation ratio",
            "Figure 2",
            "1: the expert alone; 0: the student alone. Bars are 95 % intervals over robots; "
            "shares compare each robot with the expert's under the same commands and noise.",
            tables=[Table(own.standalone, f"{own.gait.capitalize()}, alone") for own in results],
            figures=ratios.figures,
        ),
    ]


def _sequences(number: str, kind: str) -> _Figure:
    return _Figure(
        number,
        f"Gait sequences, {student_title(kind)}",
        {f"{kind}_sequence": "gait sequence"},
        note="Feet in contact (dark) over the reward machine's states, the student alone.",
    )


def _students(results: Sequence[GaitResults]) -> list[str]:
    """Lists the students of the results, each once."""
    return list(dict.fromkeys(student for own in results for student in own.r2["student"]))


def r2_by_gait(results: Sequence[GaitResults]) -> pd.DataFrame:
    """Sets the students' R² beside the paper's, a row a student and split, a column a gait."""
    rows = []
    for kind in _students(results):
        mine = {own.gait: own.r2.set_index("student").loc[kind] for own in results}
        title = student_title(kind)
        rows += [
            {"student": title, "split": split}
            | {gait: round(row[column], 4) for gait, row in mine.items()}
            for split, column in (("shuffled", "r2_shuffled_split"), ("by episode", "r2"))
        ]
        theirs = STUDENTS[kind].paper_r2
        paper = {gait: theirs.get(gait, float("nan")) for gait in mine}
        if theirs:
            rows.append({"student": title, "split": "paper"} | paper)
    return pd.DataFrame(rows)


def _tops(results: Sequence[GaitResults], method: str) -> pd.DataFrame:
    tables = [own.tops[own.tops["method"] == method] for own in results]
    return pd.concat(tables, ignore_index=True).drop(columns=["student", "method"])
