"""Is an explanation true? Take observations away in closed loop and see what is lost."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pandas as pd
from scipy import stats

from glassgait.diagrams.scenario import Scenario
from glassgait.models.arrays import Array
from glassgait.models.policies.controller import (
    AlternatingController,
    Controller,
    ControllerOutput,
    Estimator,
    alone,
)
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.task.gait import Gait
from glassgait.studies.common.cases import Case
from glassgait.studies.common.rollouts.config import RolloutConfig
from glassgait.studies.common.rollouts.scores import summarize_against
from glassgait.studies.common.rollouts.scoring import rollout_cases
from glassgait.studies.importance.observations import observation_groups

AblationMode = Literal["mean", "shuffled", "delayed"]

MODE_TITLES: dict[AblationMode, str] = {
    "mean": "replaced by its mean",
    "shuffled": "taken from another robot",
    "delayed": "one step late",
}

WHOLE = "nothing"
"""Label of the rollouts with all observations whole."""


@dataclass(frozen=True)
class AblatedController:
    """A student that acts alone, without some of its observations.

    No system of a diagram acts so: only the batch simulator plays it.

    Attributes:
        expert: The expert, whose estimator observes.
        student: The student.
        columns: The observations that are taken away.
        mode: What stands in their place.
        means: Their means (m,).
        seed: Seed of the shuffling.
    """

    expert: Policy
    student: Policy
    columns: tuple[int, ...] = ()
    mode: AblationMode = "mean"
    means: tuple[float, ...] = ()
    seed: int = 0

    @property
    def policies(self) -> dict[str, Policy]:
        """The student, for it alone acts."""
        return self._whole.policies

    @property
    def estimator(self) -> Estimator | None:
        """Maps proprioception to the body state; None where the true one is observed."""
        return self._whole.estimator

    @property
    def limits_targets(self) -> bool:
        """Whether joints follow targets within their ranges alone."""
        return self._whole.limits_targets

    @property
    def _whole(self) -> AlternatingController:
        return alone(self.student, self.expert)

    def begin(self, n_robots: int) -> Array | None:
        """Returns the observations of the step before: none."""
        return None

    def advance(self, step: int, observation: Array, memory: Array | None) -> ControllerOutput:
        """Acts by the student on observations of which some are replaced."""
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
                before = observation if memory is None else memory
                ablated[:, columns] = before[:, columns]
        return self._whole.advance(step, ablated, None)._replace(memory=observation)

    def settings(self) -> dict[str, Any]:
        """Returns all that changes the actions but the policies, as values that JSON can hold."""
        return {
            **self._whole.settings(),
            "columns": [int(column) for column in self.columns],
            "mode": self.mode,
            "means": list(self.means),
            "seed": self.seed,
        }


def ablation_cases(
    gait: Gait,
    expert: NeuralPolicy,
    students: Mapping[str, Policy],
    means: Mapping[str, Array],
    config: RolloutConfig,
) -> list[Case]:
    """Lists the rollouts of every student alone, whole and without each group of observations.

    Forward speeds are those of distillation unless the settings name others. The rollouts of a
    student do not depend on the others, so that a student more leaves those that are done alone.

    Args:
        gait: The gait.
        expert: The expert, for its estimator.
        students: The students, by kind.
        means: Means of each student's observations (n,), by kind.
        config: How robots are rolled out.
    """
    jobs = []
    config = config.at_distilled_speeds(gait)
    groups = observation_groups(expert.observation_names)
    for kind, student in students.items():
        policies: dict[tuple[str, str], Controller] = {(WHOLE, "mean"): alone(student, expert)}
        for group, columns in groups.items():
            for mode in MODE_TITLES:
                policies[group, mode] = AblatedController(
                    expert,
                    student,
                    columns=tuple(columns.tolist()),
                    mode=mode,
                    means=tuple(means[kind][columns].tolist()),
                )
        for (group, mode), policy in policies.items():
            labels = {"policy": kind, "without": group, "mode": mode}
            jobs += rollout_cases(labels, gait, policy, Scenario(), config)
    return jobs


def losses(scores: pd.DataFrame) -> pd.DataFrame:
    """Returns the share of its reward that each student loses without each group.

    Args:
        scores: Scores of `ablation_cases`.

    Returns:
        A row for each policy, group and mode: `lost` share of reward, its 95 % interval `lost_ci`,
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
