"""Students of one library model per joint: boosted trees and explainable boosting."""

from abc import abstractmethod
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Self

from annotated_types import Ge, Le
from joblib import delayed

from glassgait.models.errors import InputError
from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.settings import Count, Natural, Share, checked
from glassgait.studies.common.jobs import run_parallel
from glassgait.studies.distillation.dataset import TrainingSet
from glassgait.studies.distillation.students import StudentSettings

Depth = Annotated[Count, Le(16)]
"""Depth of a tree. Compiled trees are complete; at depth 16 they have 65,536 leaves."""

Bins = Annotated[Count, Ge(3)]
"""Bins of an observation; interpret reserves one for missing and one for unknown values."""


@checked
class EnsembleSettings(StudentSettings):
    """Settings of the library model of one joint, which `policy` compiles."""

    policy: ClassVar[type[BoostedTreesPolicy] | type[AdditivePolicy]]

    @abstractmethod
    def regressor(self, n_observations: int, seed: int) -> Any:
        """Returns the library's model before the fit."""


@checked
class GbmSettings(EnsembleSettings):
    """Settings of scikit-learn's gradient boosting.

    The paper uses the library's defaults: 100 trees of depth 3 on all samples and observations.

    Attributes:
        subsample: Share of the samples that each tree is fitted to.
        feature_share: Share of the observations that a split may choose from.
    """

    title: ClassVar[str] = "distillation: gbm"
    policy: ClassVar[type[BoostedTreesPolicy]] = BoostedTreesPolicy

    n_trees: Count = 140
    depth: Depth = 7
    learning_rate: Share = 0.1
    subsample: Share = 0.25
    feature_share: Share = 0.3

    def regressor(self, n_observations: int, seed: int) -> Any:
        from sklearn.ensemble import GradientBoostingRegressor

        return GradientBoostingRegressor(
            n_estimators=self.n_trees,
            max_depth=self.depth,
            learning_rate=self.learning_rate,
            subsample=self.subsample,
            max_features=self.feature_share,
            random_state=seed,
        )


@checked
class HistogramGbmSettings(EnsembleSettings):
    """Settings of scikit-learn's histogram gradient boosting, which is fitted faster.

    Attributes:
        round_trees: Number of trees while samples are collected.
    """

    title: ClassVar[str] = "distillation: histogram_gbm"
    policy: ClassVar[type[BoostedTreesPolicy]] = BoostedTreesPolicy

    n_trees: Count = 300
    round_trees: Count = 150
    depth: Depth = 6
    leaves: Annotated[Count, Ge(2)] = 31
    learning_rate: Share = 0.1

    def for_rounds(self) -> Self:
        return replace(self, n_trees=min(self.round_trees, self.n_trees))

    def regressor(self, n_observations: int, seed: int) -> Any:
        from sklearn.ensemble import HistGradientBoostingRegressor

        return HistGradientBoostingRegressor(
            max_iter=self.n_trees,
            max_depth=self.depth,
            max_leaf_nodes=self.leaves,
            learning_rate=self.learning_rate,
            # The stubs only know "auto".
            early_stopping=False,  # pyright: ignore[reportArgumentType]
            random_state=seed,
        )


@checked
class EbmSettings(EnsembleSettings):
    """Settings of interpret's explainable boosting.

    Attributes:
        outer_bags: Number of averaged models; their differences are the functions' error bands.
        round_bags: Upper limit of `outer_bags` while samples are collected and in the fit for the
            paper's split.
        interactions: Functions of two observations per joint; None for interpret's default, five
            per observation.
        round_interactions: Upper limit of `interactions` while samples are collected, if any.
        max_interaction_bins: Bins of an observation in functions of two observations.
        smoothing_rounds: Rounds of smooth fitting before the greedy ones.
        interaction_smoothing_rounds: The same, for functions of two observations.
    """

    title: ClassVar[str] = "distillation: ebm"
    policy: ClassVar[type[AdditivePolicy]] = AdditivePolicy

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
        if self.max_interaction_bins > self.max_bins:
            # Joints share bins, which is impossible if their pairs have finer ones.
            raise InputError(f"{self.title}: max_interaction_bins is more than max_bins; lower it")

    def for_rounds(self) -> Self:
        counts = [n for n in (self.round_interactions, self.interactions) if n is not None]
        return replace(self.for_shuffled_split(), interactions=min(counts, default=None))

    def for_shuffled_split(self) -> Self:
        return replace(self, outer_bags=min(self.round_bags, self.outer_bags))

    def regressor(self, n_observations: int, seed: int) -> Any:
        from interpret.glassbox import ExplainableBoostingRegressor

        return ExplainableBoostingRegressor(
            # Treat one-hot observations as numbers, as all students do.
            feature_types=["continuous"] * n_observations,
            outer_bags=self.outer_bags,
            interactions="5x" if self.interactions is None else self.interactions,
            max_bins=self.max_bins,
            max_interaction_bins=self.max_interaction_bins,
            max_rounds=self.max_rounds,
            learning_rate=self.learning_rate,
            smoothing_rounds=self.smoothing_rounds,
            interaction_smoothing_rounds=self.interaction_smoothing_rounds,
            n_jobs=1,
            random_state=seed,
        )


def fit_ensemble(samples: TrainingSet, settings: EnsembleSettings, *, seed: int) -> Policy:
    """Fits one library model per joint, in parallel, and compiles them to a policy."""
    names, observations = samples.observation_names, samples.observations
    calls = (
        delayed(settings.regressor(len(names), seed + joint).fit)(observations, target)
        for joint, target in enumerate(samples.actions.T)
    )
    return settings.policy.compile(samples.gait, names, list(run_parallel(calls)), samples.robot)
