"""Linear laws: one, or one for each state of the machine."""

import numpy as np
from sklearn.linear_model import Ridge

from glassgait.models.policies.linear import LinearPolicy, StatewiseLinearPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.studies.distillation.students.student import Student, StudentSettings, TrainingSet

RIDGE = 1.0
"""Weight of the penalty on the squared weights."""


def untrained_student(expert: Policy) -> Policy:
    """Returns the student before its first fit: it asks for the default stance."""
    n = len(expert.observation_names)
    zero = np.zeros((quadruped.N_JOINTS, n))
    return LinearPolicy(
        expert.gait,
        expert.observation_names,
        zero,
        np.zeros(quadruped.N_JOINTS),
        robot=expert.robot,
    )


def _fit_linear(
    samples: TrainingSet, settings: StudentSettings, *, seed: int, n_jobs: int
) -> LinearPolicy:
    model = Ridge(RIDGE).fit(samples.observations, samples.actions)
    names = samples.observation_names
    return LinearPolicy(samples.gait, names, model.coef_, model.intercept_, robot=samples.robot)


def _fit_statewise_linear(
    samples: TrainingSet, settings: StudentSettings, *, seed: int, n_jobs: int
) -> StatewiseLinearPolicy:
    models = [
        Ridge(RIDGE).fit(samples.observations[mine], samples.actions[mine])
        for mine in samples.by_state()
    ]
    weights = np.array([model.coef_ for model in models])
    intercepts = np.array([model.intercept_ for model in models])
    names = samples.observation_names
    return StatewiseLinearPolicy(samples.gait, names, weights, intercepts, robot=samples.robot)


LINEAR = Student("linear", "Linear", _fit_linear, color="#999999", marker="v", brevity=6)

STATEWISE_LINEAR = Student(
    "statewise_linear",
    "Linear per RM state",
    _fit_statewise_linear,
    color="#666666",
    marker="^",
    brevity=4,
)
