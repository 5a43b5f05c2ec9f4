"""Formulas: one for each joint, or one for each joint and state of the machine."""

import numpy as np

from glassgait.models.a1.robot import N_JOINTS
from glassgait.models.policies.symbolic import StatewiseSymbolicPolicy, SymbolicPolicy
from glassgait.studies.students.formula_fit import FormulaFit, gates, settled, shared_gates
from glassgait.studies.students.student import Student, TrainingSet
from glassgait.studies.students.symbolic_settings import (
    StatewiseSymbolicSettings,
    SymbolicSettings,
)


def _repeated_starts(samples: TrainingSet, settings: SymbolicSettings) -> TrainingSet:
    counts = np.where(samples.starts, settings.start_weights[0], 1)
    return samples.subset(np.repeat(np.arange(len(counts)), counts))


def _fit_symbolic(
    samples: TrainingSet, settings: SymbolicSettings, *, seed: int, n_jobs: int
) -> SymbolicPolicy:
    own = _repeated_starts(samples, settings)
    fit = FormulaFit(own.observation_names, shared_gates)
    formulas = fit(own.observations, own.actions, seed, settings, n_jobs)
    vocabulary, kept = fit.vocabulary.using(formulas)
    return SymbolicPolicy(
        samples.gait, samples.observation_names, kept, definitions=vocabulary.definitions
    )


def _fit_statewise_symbolic(
    samples: TrainingSet, settings: SymbolicSettings, *, seed: int, n_jobs: int
) -> StatewiseSymbolicPolicy:
    own = _repeated_starts(samples, settings)
    fit = FormulaFit(own.observation_names, gates)
    formulas = [
        settled(formula, own.observation_names, state)
        for state, mine in enumerate(own.by_state())
        for formula in fit(own.observations[mine], own.actions[mine], seed, settings, n_jobs)
    ]
    vocabulary, kept = fit.vocabulary.using(formulas)
    rows = [kept[start : start + N_JOINTS] for start in range(0, len(kept), N_JOINTS)]
    return StatewiseSymbolicPolicy(
        samples.gait, samples.observation_names, rows, definitions=vocabulary.definitions
    )


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
