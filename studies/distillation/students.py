"""Fitting students: from samples to a compiled policy, joints in parallel."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from interpret.glassbox import ExplainableBoostingRegressor
from joblib import delayed
from sklearn.ensemble import GradientBoostingRegressor, HistGradientBoostingRegressor
from sklearn.linear_model import Ridge

from glassgait.models.a1 import robot
from glassgait.models.a1.robot import Array
from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.policies.gates import statewise_symbolic_gates, symbolic_gates
from glassgait.models.policies.linear import LinearPolicy, StatewiseLinearPolicy
from glassgait.models.policies.open_loop import OpenLoopPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import StatewiseSymbolicPolicy, SymbolicPolicy
from glassgait.models.task.observation import ITERATIONS_SCALE, indices_of, machine_state_entries
from glassgait.studies.distillation.collection import samples_by_state
from glassgait.studies.distillation.config import (
    DistillationConfig,
    EbmConfig,
    GbmConfig,
    HistogramGbmConfig,
    StudentKind,
)
from glassgait.studies.distillation.symbolic_regression import fit_formulas
from glassgait.studies.parallel import run_parallel

RIDGE = 1.0
"""Weight of the penalty on the linear students' squared weights."""

OPEN_LOOP_ITERATIONS = 16
"""Moments of a machine's state that the open-loop student tells apart; commands ask for 6 to 11."""


def fit_student(
    kind: StudentKind,
    config: DistillationConfig,
    gait: str,
    observation_names: tuple[str, ...],
    observations: Array,
    actions: Array,
) -> Policy:
    """Fits a student to the expert's actions.

    Args:
        kind: Kind of student.
        config: Settings.
        gait: Name of the gait.
        observation_names: Names of the observations.
        observations: Samples (m, n).
        actions: The expert's actions (m, 12).
    """
    return _FITTERS[kind](config, gait, observation_names, observations, actions)


def fit_library_models(
    kind: StudentKind, config: DistillationConfig, observations: Array, actions: Array
) -> Sequence[Any]:
    """Fits the library's models behind a compiled student, one a joint.

    Args:
        kind: `gbm`, `histogram_gbm` or `ebm`.
        config: Settings.
        observations: Samples (m, n).
        actions: The expert's actions (m, 12).
    """
    fit, settings = {
        "gbm": (_fit_gbm_joint, config.gbm),
        "histogram_gbm": (_fit_histogram_gbm_joint, config.histogram_gbm),
        "ebm": (_fit_ebm_joint, config.ebm),
    }[kind]
    return _fit_joints(fit, config, observations, actions, settings)


def untrained_student(gait: str, observation_names: tuple[str, ...]) -> Policy:
    """Returns the student before its first fit: it asks for the default stance."""
    n = len(observation_names)
    zero = np.zeros((robot.N_JOINTS, n))
    return LinearPolicy(gait, observation_names, zero, np.zeros(robot.N_JOINTS))


def _fit_open_loop(
    config: DistillationConfig,
    gait: str,
    names: tuple[str, ...],
    observations: Array,
    actions: Array,
) -> OpenLoopPolicy:
    state = np.argmax(observations[:, machine_state_entries(names)], axis=1)
    (iterations,) = indices_of("iterations", names)
    counted = np.rint(observations[:, iterations] / ITERATIONS_SCALE).astype(int)
    iteration = np.minimum(counted, OPEN_LOOP_ITERATIONS - 1)
    n_states = len(indices_of("machine state", names))
    table = np.tile(actions.mean(axis=0), (n_states, OPEN_LOOP_ITERATIONS, 1))
    for s in range(n_states):
        for i in range(OPEN_LOOP_ITERATIONS):
            mine = (state == s) & (iteration == i)
            # A moment that was never visited goes on with the one before it.
            table[s, i] = actions[mine].mean(axis=0) if mine.any() else table[s, max(0, i - 1)]
    return OpenLoopPolicy(gait, names, table)


def _fit_linear(
    config: DistillationConfig,
    gait: str,
    names: tuple[str, ...],
    observations: Array,
    actions: Array,
) -> LinearPolicy:
    model = Ridge(RIDGE).fit(observations, actions)
    return LinearPolicy(gait, names, model.coef_, model.intercept_)


def _fit_statewise_linear(
    config: DistillationConfig,
    gait: str,
    names: tuple[str, ...],
    observations: Array,
    actions: Array,
) -> StatewiseLinearPolicy:
    models = [
        Ridge(RIDGE).fit(observations[mine], actions[mine])
        for mine in samples_by_state(observations, names)
    ]
    weights = np.array([model.coef_ for model in models])
    intercepts = np.array([model.intercept_ for model in models])
    return StatewiseLinearPolicy(gait, names, weights, intercepts)


def _fit_gbm(
    config: DistillationConfig,
    gait: str,
    names: tuple[str, ...],
    observations: Array,
    actions: Array,
) -> BoostedTreesPolicy:
    models = fit_library_models("gbm", config, observations, actions)
    return BoostedTreesPolicy.compile(gait, names, models)


def _fit_gbm_joint(
    observations: Array, target: Array, seed: int, settings: GbmConfig
) -> GradientBoostingRegressor:
    return GradientBoostingRegressor(
        n_estimators=settings.n_trees,
        max_depth=settings.depth,
        learning_rate=settings.learning_rate,
        subsample=settings.subsample,
        max_features=settings.feature_share,
        random_state=seed,
    ).fit(observations, target)


def _fit_histogram_gbm(
    config: DistillationConfig,
    gait: str,
    names: tuple[str, ...],
    observations: Array,
    actions: Array,
) -> BoostedTreesPolicy:
    models = fit_library_models("histogram_gbm", config, observations, actions)
    return BoostedTreesPolicy.compile(gait, names, models)


def _fit_histogram_gbm_joint(
    observations: Array, target: Array, seed: int, settings: HistogramGbmConfig
) -> HistGradientBoostingRegressor:
    return HistGradientBoostingRegressor(
        max_iter=settings.n_trees,
        max_depth=settings.depth,
        max_leaf_nodes=settings.leaves,
        learning_rate=settings.learning_rate,
        early_stopping=False,
        random_state=seed,
    ).fit(observations, target)


def _fit_ebm(
    config: DistillationConfig,
    gait: str,
    names: tuple[str, ...],
    observations: Array,
    actions: Array,
) -> AdditivePolicy:
    models = fit_library_models("ebm", config, observations, actions)
    return AdditivePolicy.compile(gait, names, models)


def _fit_ebm_joint(observations: Array, target: Array, seed: int, settings: EbmConfig) -> Any:
    return ExplainableBoostingRegressor(
        # One-hot observations are numbers to every student alike.
        feature_types=["continuous"] * observations.shape[1],
        outer_bags=settings.outer_bags,
        interactions=settings.interactions,
        max_bins=settings.max_bins,
        max_interaction_bins=settings.max_interaction_bins,
        max_rounds=settings.max_rounds,
        learning_rate=settings.learning_rate,
        smoothing_rounds=settings.smoothing_rounds,
        interaction_smoothing_rounds=settings.interaction_smoothing_rounds,
        n_jobs=1,
        random_state=seed,
    ).fit(observations, target)


def _fit_symbolic(
    config: DistillationConfig,
    gait: str,
    names: tuple[str, ...],
    observations: Array,
    actions: Array,
) -> SymbolicPolicy:
    gates = symbolic_gates(names)
    shape = config.symbolic.shapes_of("symbolic")[0]
    formulas = fit_formulas(
        observations, actions, config.seed, config.symbolic, shape, gates, config.n_jobs
    )
    return SymbolicPolicy(gait, names, formulas)


def _fit_statewise_symbolic(
    config: DistillationConfig,
    gait: str,
    names: tuple[str, ...],
    observations: Array,
    actions: Array,
) -> StatewiseSymbolicPolicy:
    gates = statewise_symbolic_gates(names)
    shape = config.symbolic.shapes_of("statewise_symbolic")[0]
    formulas = [
        fit_formulas(
            observations[mine],
            actions[mine],
            config.seed,
            config.symbolic,
            shape,
            gates,
            config.n_jobs,
        )
        for mine in samples_by_state(observations, names)
    ]
    return StatewiseSymbolicPolicy(gait, names, formulas)


def _fit_joints(
    fit: Callable[..., Any],
    config: DistillationConfig,
    observations: Array,
    actions: Array,
    settings: Any,
) -> Sequence[Any]:
    jobs = (
        delayed(fit)(observations, actions[:, joint], config.seed + joint, settings)
        for joint in range(robot.N_JOINTS)
    )
    return list(run_parallel(jobs, config.n_jobs))


_FITTERS: dict[str, Callable[[DistillationConfig, str, tuple[str, ...], Array, Array], Policy]] = {
    "open_loop": _fit_open_loop,
    "linear": _fit_linear,
    "statewise_linear": _fit_statewise_linear,
    "gbm": _fit_gbm,
    "histogram_gbm": _fit_histogram_gbm,
    "ebm": _fit_ebm,
    "symbolic": _fit_symbolic,
    "statewise_symbolic": _fit_statewise_symbolic,
}
