"""What an evaluation leaves behind: tables, metrics and figures, from the scores alone."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from glassgait.studies.common.figures import save_figure
from glassgait.studies.common.rollouts.scores import summarize
from glassgait.studies.common.tables import write_metrics, write_table
from glassgait.studies.evaluation.figures import reward_figure, tracking_figure
from glassgait.studies.evaluation.tables import (
    alternation_table,
    falls_table,
    scorecard_table,
    standalone_table,
)
from glassgait.studies.evaluation.tracking import tracking_table


def write_scorecard(scores: pd.DataFrame, titles: Mapping[str, str], folder: Path) -> pd.DataFrame:
    """Writes the scores of every gait in every scenario, and returns the table.

    Args:
        scores: What `run_jobs` returned.
        titles: What tables call each scenario, in their order.
        folder: Where they go.
    """
    write_table(scores, folder / "robots")
    table = scorecard_table(scores, titles)
    write_table(table, folder / "scorecard")
    write_table(falls_table(scores, titles), folder / "falls")
    means = summarize(scores, ["gait", "scenario"])
    write_metrics(means.to_dict(orient="records"), folder / "metrics.json")
    return table


def write_alternation(scores: pd.DataFrame, title: str, folder: Path) -> pd.DataFrame:
    """Writes the scores of every student at every ratio, and returns the table of those alone."""
    write_table(scores, folder / "robots")
    ratios = alternation_table(scores)
    write_table(ratios, folder / "ratios")
    write_metrics(ratios.to_dict(orient="records"), folder / "metrics.json")
    table = standalone_table(scores)
    write_table(table, folder / "standalone")
    save_figure(reward_figure(scores, title), folder / "reward")
    return table


def write_tracking(rows: pd.DataFrame, title: str, folder: Path) -> pd.DataFrame:
    """Writes how robots that keep one command follow it, and returns the table.

    Args:
        rows: What `follow` returned of all policies.
        title: What the figure calls them.
        folder: Where table and figure go.
    """
    table = tracking_table(rows)
    write_table(table, folder / "tracking")
    save_figure(tracking_figure(table, title), folder / "tracking")
    return table
