"""Students of a library's models, one a joint: boosted trees and explainable boosting."""

from collections.abc import Callable
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Self

from annotated_types import Ge, Le
from interpret.glassbox import ExplainableBoostingRegressor
from joblib import delayed
from sklearn.ensemble import GradientBoostingRegressor, HistGradientBoostingRegressor

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.models.settings import Count, Natural, Share, checked
from glassgait.studies.common.parallel.loop import run_parallel
from glassgait.studies.distillation.dataset import TrainingSet
from glassgait.studies.distillation.students import StudentSettings

Depth = Annotated[Count, Le(16)]
"""Depth of a tree: compiled trees are complete, and of this depth have 65,536 leaves."""


@checked
class GbmSettings(StudentSettings):
    """Settings of scikit-learn's gradient boosting.

    The paper uses the library's defaults: 100 trees of depth 3, of all samples and observations.

    Attributes:
        n_trees: Number of trees.
        depth: Depth of a tree.
        learning_rate: Share of a tree's correction that is kept.
        subsample: Share of the samples that a tree sees.
        feature_share: Share of the observations that a split may choose from.
    """

    title: ClassVar[str] = "distillation: gbm"

    n_trees: Count = 140
    depth: Depth = 7
    learning_rate: Share = 0.1
    subsample: Share = 0.25
    feature_share: Share = 0.3


@checked
class HistogramGbmSettings(StudentSettings):
    """Settings of scikit-learn's histogram gradient boosting, the fast one.

    Attributes:
        n_trees: Number of trees.
        round_trees: The same while samples are collected.
        depth: Greatest depth of a tree.
        leaves: Greatest number of leaves of a tree.
        learning_rate: Share of a tree's correction that is kept.
    """

    title: ClassVar[str] = "distillation: histogram_gbm"

    n_trees: Count = 300
    round_trees: Count = 150
    depth: Depth = 6
    leaves: Annotated[Count, Ge(2)] = 31
    learning_rate: Share = 0.1

    def for_rounds(self) -> Self:
        """Returns the settings of the students that collect samples: fewer trees."""
        return replace(self, n_trees=min(self.round_trees, self.n_trees))


def boosting_regressor(settings: GbmSettings, seed: int) -> GradientBoostingRegressor:
    """Makes scikit-learn's model of one joint, not yet fitted."""
    return GradientBoostingRegressor(
        n_estimators=settings.n_trees,
        max_depth=settings.depth,
        learning_rate=settings.learning_rate,
        subsample=settings.subsample,
        max_features=settings.feature_share,
        random_state=seed,
    )


def _fit_gbm_joint(
    observations: Array, target: Array, seed: int, settings: GbmSettings
) -> GradientBoostingRegressor:
    return boosting_regressor(settings, seed).fit(observations, target)


def _fit_histogram_gbm_joint(
    observations: Array, target: Array, seed: int, settings: HistogramGbmSettings
) -> HistGradientBoostingRegressor:
    return HistGradientBoostingRegressor(
        max_iter=settings.n_trees,
        max_depth=settings.depth,
        max_leaf_nodes=settings.leaves,
        learning_rate=settings.learning_rate,
        # The stubs know of "auto" alone.
        early_stopping=False,  # pyright: ignore[reportArgumentType]
        random_state=seed,
    ).fit(observations, target)


Bins = Annotated[Count, Ge(3)]
"""Bins of an observation: interpret keeps one for missing values and one for unknown ones."""


@checked
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


FitJoint = Callable[[Array, Array, int, Any], Any]
"""Fits the model of a joint: `fit_joint(observations, target, seed, settings)`."""

LIBRARY_MODELS: dict[str, tuple[FitJoint, Callable[..., Policy]]] = {
    "gbm": (_fit_gbm_joint, BoostedTreesPolicy.compile),
    "histogram_gbm": (_fit_histogram_gbm_joint, BoostedTreesPolicy.compile),
    "ebm": (_fit_ebm_joint, AdditivePolicy.compile),
}
"""How a student's model of a joint is fitted, and how its models become a policy."""


def fit_models(
    kind: str, samples: TrainingSet, settings: StudentSettings, *, seed: int, n_jobs: int
) -> list[Any]:
    """Fits a library's models of all joints, some at once."""
    fit_joint, _ = LIBRARY_MODELS[kind]
    jobs = (
        delayed(fit_joint)(samples.observations, samples.actions[:, joint], seed + joint, settings)
        for joint in range(quadruped.N_JOINTS)
    )
    return list(run_parallel(jobs, n_jobs))


def fit_ensemble(
    kind: str, samples: TrainingSet, settings: StudentSettings, *, seed: int, n_jobs: int
) -> Policy:
    """Fits a library's models of all joints, and compiles them to a policy."""
    models = fit_models(kind, samples, settings, seed=seed, n_jobs=n_jobs)
    _, compile_models = LIBRARY_MODELS[kind]
    return compile_models(samples.gait, samples.observation_names, models, samples.robot)
