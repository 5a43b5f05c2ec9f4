"""The report's contents: the paper's tables and figures, and ours in their place."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from glassgait.studies.distillation.students import STUDENTS, paper_students, policy_title
from glassgait.studies.reproduction.gait import GaitResults
from glassgait.studies.reproduction.page import Section

FRAMEWORK = Path(__file__).parents[1] / "pictures" / "locomotion.svg"

JOINT_FIGURES = {
    "6": ("A weak learner of the GBM", "gbm_FL_hip_tree"),
    "7": ("Partial dependence on the top 3 observations, GBM", "gbm_FL_hip_partial_dependence"),
    "8, top": ("Functions of one observation, explainable boosting", "ebm_FL_hip_shapes"),
    "8, bottom": ("A function of two observations, explainable boosting", "ebm_FL_hip_pair_1"),
    "9": ("Local explanation, explainable boosting", "ebm_local"),
    "10": ("Global importances of the terms, explainable boosting", "ebm_FL_hip_terms"),
}
"""Figures of FL hip: title and stem of the file, by the paper's number."""

WIDE = ("6", "7", "8, top")
"""Those whose pictures take the page's whole width."""


def contents(results: Sequence[GaitResults]) -> list[Section]:
    """Lists everything in the paper's order, then the gait sequences of further students."""
    # Gait sequences of students beyond the paper's come last.
    further = [kind for kind in _students(results) if kind not in paper_students()]
    papers = dict(zip(("Figure 3", "Figure 4", "Figure 5"), paper_students(), strict=True))
    ours = {f"Ours {place}": kind for place, kind in enumerate(further, start=1)}
    importances = {
        "gbm_impurity": "impurity importance",
        "gbm_permutation": "permutation importance",
    }
    return [
        Section(
            "The framework, as the Drake diagram that runs it",
            "Figure 1",
            "Expert and student sit behind one switch; the alternation chooses which of them acts.",
            figures=[("Block diagram of the closed loop", FRAMEWORK)],
            wide=True,
        ),
        *_tables(results),
        *(_sequences(results, number, kind) for number, kind in papers.items()),
        *(
            Section(
                f"{title}, FL hip",
                f"Figure {number}",
                figures=_figures(results, stem, title),
                wide=number in WIDE,
            )
            for number, (title, stem) in JOINT_FIGURES.items()
        ),
        Section(
            "Observation importances of the GBM, by two methods",
            "Figure 11",
            figures=[
                figure
                for stem, what in importances.items()
                for figure in _figures(results, stem, what)
            ],
            wide=True,
        ),
        *(_sequences(results, number, kind) for number, kind in ours.items()),
    ]


def _figures(results: Sequence[GaitResults], stem: str, what: str) -> list[tuple[str, Path]]:
    """Lists one picture of every gait with its caption."""
    return [(f"{own.gait.capitalize()}: {what}", own.folder / f"{stem}.png") for own in results]


def _sequences(results: Sequence[GaitResults], number: str, kind: str) -> Section:
    return Section(
        f"Gait sequences, {policy_title(kind)}",
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
            "1: the expert alone; 0: the student alone. Bars are 95 % intervals over robots; "
            "shares compare each robot with the expert's under the same commands and noise.",
            tables=[(f"{own.gait.capitalize()}, alone", own.standalone) for own in results],
            figures=_figures(results, "return", "return against ratio"),
        ),
    ]


def _students(results: Sequence[GaitResults]) -> list[str]:
    """Lists the students of the results, each once."""
    return list(dict.fromkeys(student for own in results for student in own.r2["student"]))


def r2_by_gait(results: Sequence[GaitResults]) -> pd.DataFrame:
    """Sets the students' R² beside the paper's, a row a student and split, a column a gait."""
    rows = []
    for kind in _students(results):
        mine = {own.gait: own.r2.set_index("student").loc[kind] for own in results}
        title = policy_title(kind)
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
