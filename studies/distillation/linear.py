"""Linear laws: one per joint, or one per joint and RM state."""

import numpy as np
from sklearn.linear_model import Ridge

from glassgait.models.policies.linear import LinearPerStatePolicy, LinearPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.studies.distillation.dataset import TrainingSet
from glassgait.studies.distillation.students import StudentSettings

RIDGE = 1.0  # weight of the penalty on the squared weights


def untrained_student(expert: Policy) -> Policy:
    """Returns the student before its first fit, whose targets are the default stance."""
    names, n_joints = expert.observation_names, quadruped.N_JOINTS
    weights, intercepts = np.zeros((n_joints, len(names))), np.zeros(n_joints)
    return LinearPolicy(expert.gait, names, weights, intercepts, robot=expert.robot)


def fit_linear(samples: TrainingSet, settings: StudentSettings, *, seed: int) -> LinearPolicy:
    """Fits one law per joint by ridge regression."""
    model = Ridge(RIDGE).fit(samples.observations, samples.actions)
    names = samples.observation_names
    return LinearPolicy(samples.gait, names, model.coef_, model.intercept_, robot=samples.robot)


def fit_linear_per_state(
    samples: TrainingSet, settings: StudentSettings, *, seed: int
) -> LinearPerStatePolicy:
    """Fits one law per joint and RM state by ridge regression."""
    models = [
        Ridge(RIDGE).fit(samples.observations[mask], samples.actions[mask])
        for mask in samples.by_state()
    ]
    weights = np.array([model.coef_ for model in models])
    intercepts = np.array([model.intercept_ for model in models])
    names = samples.observation_names
    return LinearPerStatePolicy(samples.gait, names, weights, intercepts, robot=samples.robot)
