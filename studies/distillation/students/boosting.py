"""Boosted trees, by scikit-learn: exact, and by histograms."""

from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, ClassVar, Self

from annotated_types import Ge, Le
from sklearn.ensemble import GradientBoostingRegressor, HistGradientBoostingRegressor

from glassgait.models.arrays import Array
from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.settings import Count, Share
from glassgait.studies.distillation.students.student import (
    Student,
    StudentSettings,
    fit_compiled,
    fit_joints,
)

Depth = Annotated[Count, Le(16)]
"""Depth of a tree: compiled trees are complete, and of this depth have 65,536 leaves."""


@dataclass(frozen=True)
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


@dataclass(frozen=True)
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


HISTOGRAM_GBM = Student(
    "histogram_gbm",
    "GBM, histograms",
    partial(fit_compiled, _fit_histogram_gbm_joint, BoostedTreesPolicy.compile),
    color="#56B4E9",
    marker="h",
    settings=HistogramGbmSettings(),
    fit_models=partial(fit_joints, _fit_histogram_gbm_joint),
    compile=BoostedTreesPolicy.compile,
)

GBM = Student(
    "gbm",
    "GBM",
    partial(fit_compiled, _fit_gbm_joint, BoostedTreesPolicy.compile),
    color="#0072B2",
    marker="o",
    settings=GbmSettings(),
    # The two differ little in where they go, and histograms are fitted five times as fast.
    collector=HISTOGRAM_GBM.name,
    fit_models=partial(fit_joints, _fit_gbm_joint),
    compile=BoostedTreesPolicy.compile,
    paper_r2={"walk": 0.9705, "trot": 0.9863, "pace": 0.9752, "bound": 0.9537},
)
