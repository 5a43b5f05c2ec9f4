"""The table of falls on a page, read again, so that the map of falls is drawn from it."""

import re

import pandas as pd

from glassgait.diagrams.scenario import TRAINING
from glassgait.studies.common.policies import EXPERT
from glassgait.studies.distillation.students.boosting import EBM, GBM
from glassgait.studies.distillation.students.sparse_formula import SPARSE_FORMULA
from glassgait.studies.distillation.students.symbolic import STATEWISE_SYMBOLIC

POLICIES = (EXPERT, STATEWISE_SYMBOLIC.name, GBM.name, EBM.name, SPARSE_FORMULA.name)
"""Whose falls a cell holds, in this order; a gait without a page holds four numbers."""

ROBOTS = 26


def fall_lines(page: str) -> list[str]:
    """Returns the lines of the table on a page whose first column is the scenario.

    Args:
        page: The page, in Markdown.
    """
    start = page.index("| scenario | walk |")
    return page[start:].split("\n\n", maxsplit=1)[0].splitlines()


def falls_on(page: str) -> dict[str, pd.DataFrame]:
    """Reads the falls of each gait, a row a policy and scenario, as the map takes them.

    A dash is what was not measured, and left out.

    Args:
        page: The page, in Markdown.
    """
    head, _, *lines = [re.split(r" *\| *", line.strip("| ")) for line in fall_lines(page)]
    tables = {}
    for column, gait in enumerate(head[1:], start=1):
        rows = [
            {
                "scenario": TRAINING if "(training)" in line[0] else line[0],
                "world": line[0],
                "policy": policy,
                "robots": ROBOTS,
                "falls": int(falls),
                "fall_rate": int(falls) / ROBOTS,
            }
            for line in lines
            for policy, falls in zip(POLICIES, line[column].split(" / "), strict=False)
            if falls != "–"
        ]
        tables[gait] = pd.DataFrame(rows)
    return tables
