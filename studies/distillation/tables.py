"""The R² table (paper, Table II), from what a distillation wrote."""

from pathlib import Path

import pandas as pd

from glassgait.studies.common.tables import write_metrics, write_table
from glassgait.studies.distillation.students.registry import STUDENTS, student_title


def r2_table(r2: pd.DataFrame, gait: str) -> pd.DataFrame:
    """Formats the scores for reading, the paper's beside ours."""
    paper = [STUDENTS[kind].paper_r2.get(gait, float("nan")) for kind in r2["student"]]
    return pd.DataFrame(
        {
            "student": [student_title(kind) for kind in r2["student"]],
            "R² (episodes held out)": r2["r2"].round(4),
            "R² (paper's shuffled split)": r2["r2_shuffled_split"].round(4),
            "paper": paper,
            "worst joint": r2.filter(regex="^r2_.._").min(axis=1).round(4),
        }
    )


def write_r2_table(r2: pd.DataFrame, gait: str, folder: Path) -> pd.DataFrame:
    """Writes the scores as metrics.json, r2.csv and r2.md, and returns the table."""
    table = r2_table(r2, gait)
    write_table(table, folder / "r2")
    # Wall time is left out: equal runs give equal metrics.
    metrics = r2.drop(columns="minutes").set_index("student").to_dict(orient="index")
    write_metrics(metrics, folder / "metrics.json")
    return table
