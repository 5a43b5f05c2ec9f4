"""The report's contents: the paper's tables and figures, and ours in their place."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from glassgait.studies.distillation.students import STUDENTS, paper_students
from glassgait.studies.reproduction.page import Section

JOINT_FIGURES = {
    "6": ("A decision tree of the GBM", "gbm_FL_hip_tree", "walk"),
    "7": ("Partial dependence on the top 3 inputs, GBM", "gbm_FL_hip_partial_dependence", "walk"),
    "8, top": ("Functions of one observation, EBM", "ebm_FL_hip_shapes", "trot"),
    "8, bottom": ("A function of two observations, EBM", "ebm_FL_hip_pair_1", "trot"),
    "9": ("Local explanation, EBM", "ebm_local", "pace"),
    "10": ("Global importances of the terms, EBM", "ebm_FL_hip_terms", None),
}
"""Figures of FL hip by the paper's number: title, file stem and the paper's gait; None for all."""

WIDE = ("6", "7", "8, top")  # figures as wide as the page


@dataclass(frozen=True)
class GaitResults:
    """Results of one gait: R² of students, their scores without the expert, and the most important
    observations beside the paper's."""

    gait: str
    folder: Path
    r2: pd.DataFrame
    standalone: pd.DataFrame
    tops: pd.DataFrame


def contents(results: Sequence[GaitResults]) -> list[Section]:
    """Lists everything in the paper's order, then the gait sequences of further students."""
    numbers = dict(zip(paper_students(), ("Figure 3", "Figure 4", "Figure 5"), strict=True))
    further = [kind for kind in _students(results) if kind not in numbers]
    diagram = Path(__file__).parents[1] / "pictures" / "locomotion.svg"
    framework = Section(
        "The framework, as the Drake diagram that runs it",
        "Figure 1",
        "Expert and student sit behind one switch; the alternation chooses which of them acts.",
        figures=[("Block diagram of the closed loop", diagram)],
        wide=True,
    )
    of_joint = [
        Section(
            f"{title}, FL hip",
            f"Figure {number}",
            figures=_figures(results, stem, title, gait),
            wide=number in WIDE,
        )
        for number, (title, stem, gait) in JOINT_FIGURES.items()
    ]
    maps = [
        picture
        for method in ("impurity", "permutation")
        for picture in _figures(results, f"gbm_{method}", f"{method} importance")
    ]
    return [
        framework,
        *_tables(results),
        *(_sequences(results, number, kind) for kind, number in numbers.items()),
        *of_joint,
        Section(
            "Observation importances of the GBM, by two methods",
            "Figure 11",
            figures=maps,
            wide=True,
        ),
        *(_sequences(results, f"Ours {n}", kind) for n, kind in enumerate(further, start=1)),
    ]


def _figures(
    results: Sequence[GaitResults], stem: str, title: str, gait: str | None = None
) -> list[tuple[str, Path]]:
    """Lists the picture of a gait with its caption, or of all gaits if that one was not studied."""
    shown = [result for result in results if result.gait == gait] or results
    return [(f"{one.gait.capitalize()}: {title}", one.folder / f"{stem}.png") for one in shown]


def _sequences(results: Sequence[GaitResults], number: str, kind: str) -> Section:
    return Section(
        f"Gait sequences, {kind}",
        number,
        "Feet in contact (dark) over the reward machine's states, without the expert.",
        figures=_figures(results, f"{kind}_sequence", "gait sequence"),
        wide=True,
    )


def _tables(results: Sequence[GaitResults]) -> list[Section]:
    return [
        Section(
            "Top 3 observations by importance for each joint type, GBM (boosted trees)",
            "Table I",
            "An asterisk marks what the paper lists at the same place.",
            tables=[
                ("Feature importance (impurity)", _tops(results, "impurity")),
                ("Permutation importance", _tops(results, "permutation")),
            ],
        ),
        Section(
            "R² on test sets",
            "Table II",
            "Ours by the paper's shuffled split, the paper's beside it, and ours with whole "
            "episodes held out.",
            tables=[("", r2_by_gait(results))],
        ),
        Section(
            "Return and falls against the alternation ratio",
            "Figure 2",
            "1: only the expert; 0: only the student. Bars are 95 % intervals over robots; "
            "shares compare each robot with the expert's under the same commands and noise.",
            tables=[(f"{one.gait.capitalize()}, students only", one.standalone) for one in results],
            figures=_figures(results, "return", "return against ratio"),
        ),
    ]


def _students(results: Sequence[GaitResults]) -> list[str]:
    """Lists the students of the results, each once."""
    return list(dict.fromkeys(kind for result in results for kind in result.r2["student"]))


def r2_by_gait(results: Sequence[GaitResults]) -> pd.DataFrame:
    """Sets the students' R² beside the paper's: rows are students and splits, columns gaits."""
    rows = []
    for kind in _students(results):
        scores = {result.gait: result.r2.set_index("student").loc[kind] for result in results}
        for split, column in (("shuffled", "r2_shuffled_split"), ("by episode", "r2")):
            ours = {gait: round(row[column], 4) for gait, row in scores.items()}
            rows.append({"student": kind, "split": split} | ours)
        # The paper has only some kinds of students.
        if published := STUDENTS[kind].paper_r2:
            paper = {gait: published.get(gait, float("nan")) for gait in scores}
            rows.append({"student": kind, "split": "paper"} | paper)
    return pd.DataFrame(rows)


def _tops(results: Sequence[GaitResults], method: str) -> pd.DataFrame:
    tops = pd.concat([result.tops for result in results], ignore_index=True)
    return tops[tops["method"] == method].drop(columns=["student", "method"])
