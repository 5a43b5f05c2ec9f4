"""Formulas: one for each joint, or one for each joint and state of the machine."""

from collections.abc import Callable, Sequence

import numpy as np

from glassgait.models.formulas.expression import Expression
from glassgait.models.formulas.quantities import Vocabulary
from glassgait.models.policies.symbolic import (
    FormulaPolicy,
    StatewiseSymbolicPolicy,
    SymbolicPolicy,
)
from glassgait.models.robots.quadruped import N_JOINTS
from glassgait.studies.distillation.students.formula_fit import (
    FormulaFit,
    gates,
    settled,
    shared_gates,
)
from glassgait.studies.distillation.students.student import Student, TrainingSet
from glassgait.studies.distillation.students.symbolic_regression import (
    StatewiseSymbolicSettings,
    SymbolicSettings,
)


def _repeated_starts(samples: TrainingSet, settings: SymbolicSettings) -> TrainingSet:
    counts = np.where(samples.starts, settings.start_weights[0], 1)
    return samples.subset(np.repeat(np.arange(len(counts)), counts))


def fit_policy(
    samples: TrainingSet,
    gates: Callable[[Vocabulary], Sequence[Expression]],
    settings: SymbolicSettings,
    *,
    statewise: bool,
    seed: int = 0,
    n_jobs: int = 1,
) -> FormulaPolicy:
    """Fits a formula for each joint, or one for each joint and state of the machine.

    Args:
        samples: What the formulas are fitted to.
        gates: Returns what encodes where in the gait the robot is.
        settings: Engine and budget; of several shapes the first counts.
        statewise: Whether each state of the machine has formulas of its own.
        seed: Seed of the search.
        n_jobs: Formulas that are searched at once.

    Raises:
        InputError: if the engine is PySR and Julia cannot start, or its search fails.
    """
    names = samples.observation_names
    fit = FormulaFit(samples.robot, names, gates)
    if not statewise:
        formulas = fit(samples.observations, samples.actions, seed, settings, n_jobs)
        vocabulary, kept = fit.vocabulary.using(formulas)
        return SymbolicPolicy(
            samples.gait,
            names,
            kept,
            definitions=vocabulary.definitions,
            robot=samples.robot,
        )
    formulas = [
        settled(formula, names, state)
        for state, mine in enumerate(samples.by_state())
        for formula in fit(
            samples.observations[mine], samples.actions[mine], seed, settings, n_jobs
        )
    ]
    vocabulary, kept = fit.vocabulary.using(formulas)
    rows = [kept[start : start + N_JOINTS] for start in range(0, len(kept), N_JOINTS)]
    return StatewiseSymbolicPolicy(
        samples.gait,
        names,
        rows,
        definitions=vocabulary.definitions,
        robot=samples.robot,
    )


def _fit_symbolic(
    samples: TrainingSet, settings: SymbolicSettings, *, seed: int, n_jobs: int
) -> FormulaPolicy:
    own = _repeated_starts(samples, settings)
    return fit_policy(own, shared_gates, settings, statewise=False, seed=seed, n_jobs=n_jobs)


def _fit_statewise_symbolic(
    samples: TrainingSet, settings: SymbolicSettings, *, seed: int, n_jobs: int
) -> FormulaPolicy:
    own = _repeated_starts(samples, settings)
    return fit_policy(own, gates, settings, statewise=True, seed=seed, n_jobs=n_jobs)


SYMBOLIC = Student(
    "symbolic",
    "Symbolic",
    _fit_symbolic,
    color="#009E73",
    marker="D",
    settings=SymbolicSettings(),
    brevity=2,
    paper_r2={"walk": 0.6811, "trot": 0.7334, "pace": 0.7331, "bound": 0.6564},
)

STATEWISE_SYMBOLIC = Student(
    "statewise_symbolic",
    "Symbolic per RM state",
    _fit_statewise_symbolic,
    color="#CC79A7",
    marker="P",
    settings=StatewiseSymbolicSettings(),
    brevity=3,
)
