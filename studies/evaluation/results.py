"""What an evaluation leaves behind: tables, metrics and figures, from the scores alone."""

from pathlib import Path

import pandas as pd

from glassgait.studies.evaluation.figures import reward_figure
from glassgait.studies.evaluation.tables import (
    alternation_table,
    falls_table,
    scorecard_table,
    standalone_table,
)
from glassgait.studies.figures import save_figure
from glassgait.studies.rollouts.scores import summarize
from glassgait.studies.tables import write_metrics, write_table


def write_scorecard(scores: pd.DataFrame, folder: Path) -> pd.DataFrame:
    """Writes the scores of every gait in every world, and returns the table."""
    write_table(scores, folder / "robots")
    table = scorecard_table(scores)
    write_table(table, folder / "scorecard")
    write_table(falls_table(scores), folder / "falls")
    means = summarize(scores, ["gait", "world"])
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
