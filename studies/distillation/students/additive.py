"""Additive models, by interpret's explainable boosting."""

from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Any, ClassVar, Self

from annotated_types import Ge
from interpret.glassbox import ExplainableBoostingRegressor

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.settings import Count, Natural, Share
from glassgait.studies.distillation.students.student import (
    Student,
    StudentSettings,
    fit_compiled,
    fit_joints,
)

Bins = Annotated[Count, Ge(3)]
"""Bins of an observation: interpret keeps one for missing values and one for unknown ones."""


@dataclass(frozen=True)
class EbmSettings(StudentSettings):
    """Settings of interpret's explainable boosting.

    Attributes:
        outer_bags: Models that are averaged; how much they differ is the error band of every
            function.
        round_bags: The same, at most, while samples are collected and in the fit that the paper's
            split scores.
        interactions: Functions of two observations, a joint; None for five of each observation,
            which is interpret's default.
        round_interactions: The same, at most, while samples are collected; None for as many.
        max_bins: Bins of an observation.
        max_interaction_bins: Bins of an observation in functions of two.
        max_rounds: Greatest number of boosting rounds.
        learning_rate: Share of a round's correction that is kept.
        smoothing_rounds: Rounds of smooth fitting before the greedy ones.
        interaction_smoothing_rounds: The same, for functions of two.
    """

    title: ClassVar[str] = "distillation: ebm"

    outer_bags: Count = 4
    round_bags: Count = 1
    interactions: Natural | None = 60
    round_interactions: Natural | None = 60
    max_bins: Bins = 128
    max_interaction_bins: Bins = 16
    max_rounds: Count = 100
    learning_rate: Share = 0.2
    smoothing_rounds: Natural = 20
    interaction_smoothing_rounds: Natural = 5

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.max_interaction_bins > self.max_bins:
            # Joints could not share their bins: each would keep the finer ones where it has them.
            raise InputError(
                f"{self.title}: max_interaction_bins is {self.max_interaction_bins}, more than "
                f"max_bins = {self.max_bins}; lower it or raise max_bins"
            )

    def for_rounds(self) -> Self:
        """Returns the settings of the students that collect samples: fewer bags and functions."""
        counts = [n for n in (self.round_interactions, self.interactions) if n is not None]
        few = self.for_shuffled_split()
        return replace(few, interactions=min(counts, default=None))

    def for_shuffled_split(self) -> Self:
        """Returns the settings of the fit that is scored by the paper's split, of fewer bags."""
        return replace(self, outer_bags=min(self.round_bags, self.outer_bags))


def additive_regressor(
    settings: EbmSettings, n_observations: int, seed: int
) -> ExplainableBoostingRegressor:
    """Makes interpret's model of one joint, not yet fitted."""
    return ExplainableBoostingRegressor(
        # One-hot observations are numbers to every student alike.
        feature_types=["continuous"] * n_observations,
        outer_bags=settings.outer_bags,
        interactions="5x" if settings.interactions is None else settings.interactions,
        max_bins=settings.max_bins,
        max_interaction_bins=settings.max_interaction_bins,
        max_rounds=settings.max_rounds,
        learning_rate=settings.learning_rate,
        smoothing_rounds=settings.smoothing_rounds,
        interaction_smoothing_rounds=settings.interaction_smoothing_rounds,
        n_jobs=1,
        random_state=seed,
    )


def _fit_ebm_joint(observations: Array, target: Array, seed: int, settings: EbmSettings) -> Any:
    return additive_regressor(settings, observations.shape[1], seed).fit(observations, target)


EBM = Student(
    "ebm",
    "EBM",
    partial(fit_compiled, _fit_ebm_joint, AdditivePolicy.compile),
    color="#D55E00",
    marker="s",
    settings=EbmSettings(),
    fit_models=partial(fit_joints, _fit_ebm_joint),
    compile=AdditivePolicy.compile,
    brevity=5,
    paper_r2={"walk": 0.9787, "trot": 0.9906, "pace": 0.9819, "bound": 0.9637},
)
