"""Formulas: one for each joint, or one for each joint and state of the machine."""

import numpy as np

from glassgait.models.policies.gates import statewise_symbolic_gates, symbolic_gates
from glassgait.models.policies.symbolic import StatewiseSymbolicPolicy, SymbolicPolicy
from glassgait.studies.students.student import Student, TrainingSet
from glassgait.studies.students.symbolic_regression import fit_formulas
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
    names, own = samples.observation_names, _repeated_starts(samples, settings)
    gates = symbolic_gates(names)
    formulas = fit_formulas(own.observations, own.actions, seed, settings, gates, n_jobs)
    return SymbolicPolicy(samples.gait, names, formulas)


def _fit_statewise_symbolic(
    samples: TrainingSet, settings: SymbolicSettings, *, seed: int, n_jobs: int
) -> StatewiseSymbolicPolicy:
    names, own = samples.observation_names, _repeated_starts(samples, settings)
    gates = statewise_symbolic_gates(names)
    formulas = [
        fit_formulas(own.observations[mine], own.actions[mine], seed, settings, gates, n_jobs)
        for mine in own.by_state()
    ]
    return StatewiseSymbolicPolicy(samples.gait, names, formulas)


SYMBOLIC = Student(
    "symbolic",
    "Symbolic",
    _fit_symbolic,
    color="#009E73",
    marker="D",
    settings=SymbolicSettings(),
    brevity=1,
    paper_r2={"walk": 0.6811, "trot": 0.7334, "pace": 0.7331, "bound": 0.6564},
)

STATEWISE_SYMBOLIC = Student(
    "statewise_symbolic",
    "Symbolic per RM state",
    _fit_statewise_symbolic,
    color="#CC79A7",
    marker="P",
    settings=StatewiseSymbolicSettings(),
    brevity=2,
)
