"""The figure of the curricula: what students earn alone, and how often they fall."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from glassgait.studies.common.figures import COLUMN_WIDTH, styled, subplots
from glassgait.studies.distillation.students.registry import STUDENTS

TICKS = {
    "expert_only": "expert\nonly",
    "half": "half",
    "student_only": "student\nonly",
    "alternation": "alternation",
    "alternation_then_alone": "alternation,\nthen alone",
}


@styled
def curricula_figure(table: pd.DataFrame, title: str) -> Figure:
    """Draws share of the expert's return and falls of each student, by curriculum.

    Args:
        table: What `curricula_table` returned.
        title: Title of the figure.
    """
    figure, (share, falls) = subplots(
        2, 1, figsize=(COLUMN_WIDTH, 3.4), sharex=True, height_ratios=(3, 2)
    )
    students = list(dict.fromkeys(table["student"]))
    for i, student in enumerate(students):
        line = STUDENTS[student]
        mine = table[table["student"] == student].set_index("curriculum").reindex(list(TICKS))
        at = np.arange(len(TICKS)) + 0.12 * (i - (len(students) - 1) / 2)
        style = {"color": line.color, "marker": line.marker, "markersize": 3.5, "linestyle": "none"}
        share.errorbar(at, mine["share"], mine["share_ci"], label=line.title, capsize=1.5, **style)
        falls.plot(at, 100 * mine["fall_rate"].astype(float), **style)
    share.axhline(1.0, color="black", linewidth=0.8, linestyle=":")
    share.set(ylabel="share of the\nexpert's return", ylim=(0, None), title=title)
    share.legend(ncols=2, loc="lower right")
    falls.set(ylabel="falls (%)", ylim=(-5, 105), xlabel="what acts while samples are collected")
    falls.set_xticks(np.arange(len(TICKS)), list(TICKS.values()))
    figure.align_ylabels()
    return figure
