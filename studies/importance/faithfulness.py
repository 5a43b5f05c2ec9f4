"""Is an explanation true? Take observations away in closed loop and see what is lost."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pandas as pd
from scipy import stats

from glassgait.models.arrays import Array
from glassgait.models.policies.controller import (
    ControllerOutput,
    WrappedController,
)
from glassgait.studies.common.scores import summarize_against

AblationMode = Literal["mean", "shuffled", "delayed"]

MODE_TITLES: dict[AblationMode, str] = {
    "mean": "replaced by its mean",
    "shuffled": "taken from another robot",
    "delayed": "one step late",
}

WHOLE = "nothing"
"""Label of the rollouts with all observations whole."""


@dataclass(frozen=True)
class AblatedController(WrappedController):
    """Acts on observations of which some are taken away; no system of a diagram does so.

    Attributes:
        columns: The observations that are taken away.
        mode: What stands in their place.
        means: Their means (m,).
        seed: Seed of the shuffling.
    """

    columns: tuple[int, ...] = ()
    mode: AblationMode = "mean"
    means: tuple[float, ...] = ()
    seed: int = 0

    def begin(self, n_robots: int) -> tuple[Any, Array]:
        """Returns the other controller's memory, and the observations of the step before: none."""
        nothing = np.full((n_robots, len(self.expert.observation_names)), np.nan)
        return self.inner.begin(n_robots), nothing

    def advance(self, step: int, observation: Array, memory: Any) -> ControllerOutput:
        """Acts at a control step."""
        inner, before = memory
        ablated = observation.copy()
        columns = np.array(self.columns, dtype=np.int64)
        match self.mode:
            case "mean":
                ablated[:, columns] = self.means
            case "shuffled":
                generator = np.random.default_rng([self.seed, step])
                other = generator.permutation(len(observation))
                ablated[:, columns] = observation[np.ix_(other, columns)]
            case "delayed":
                known = np.where(np.isnan(before), observation, before)
                ablated[:, columns] = known[:, columns]
        output = self.inner.advance(step, ablated, inner)
        return output._replace(memory=(output.memory, observation))

    def settings(self) -> dict[str, Any]:
        """Returns all that changes the actions but the policies, as values that JSON can hold."""
        return {
            **self.inner.settings(),
            "columns": [int(column) for column in self.columns],
            "mode": self.mode,
            "means": list(self.means),
            "seed": self.seed,
        }


def losses(scores: pd.DataFrame) -> pd.DataFrame:
    """Returns the share of its return that each student loses without each group.

    Args:
        scores: Scores of robots, a row each, of every student with all observations whole
            (`without` is `nothing`) and without each group.

    Returns:
        A row for each policy, group and mode: `lost` share of return, its 95 % interval `lost_ci`,
        and `fall_rate`.
    """
    by = ["policy", "without", "mode"]
    tables = []
    for _, own in scores.groupby("policy", sort=False):
        whole = own["without"] == WHOLE
        tables.append(summarize_against(own[~whole], by, own[whole]))
    means = pd.concat(tables, ignore_index=True)
    means["lost"], means["lost_ci"] = 1.0 - means["share"], means["share_ci"]
    columns = ["policy", "without", "mode", "lost", "lost_ci", "fall_rate"]
    return means[columns]


def rank_correlations(importances: pd.DataFrame, lost: pd.DataFrame) -> pd.DataFrame:
    """Correlates the ranks of importances with the ranks of measured losses (Spearman).

    Args:
        importances: Columns `policy`, `method`, `without` (the group) and `importance`.
        lost: What `losses` returned.

    Returns:
        A row for each policy, method and mode: `correlation` and its `p_value`.
    """
    rows = []
    joined = importances.merge(lost, on=["policy", "without"])
    by = ["policy", "method", "mode"]
    for labels, own in joined.groupby(by, sort=False):
        result: Any = stats.spearmanr(own["importance"], own["lost"])
        rows.append(
            {
                **dict(zip(by, labels, strict=True)),
                "correlation": float(result.statistic),
                "p_value": float(result.pvalue),
            }
        )
    return pd.DataFrame(rows)
