"""Single fits of students, each to a law that it must find, and their scores."""

import numpy as np
from sklearn.metrics import r2_score

from glassgait.models.policies.library import load_expert
from glassgait.studies.distillation.students.dataset import Dataset, r2_scores
from glassgait.studies.distillation.students.registry import STUDENTS
from glassgait.studies.distillation.students.student import TrainingSet
from glassgait.studies.distillation.students.symbolic_regression import SymbolicSettings


def fit(kind, names, data, settings=None):
    """Fits a student of the trot, in this process."""
    samples = TrainingSet("trot", names, data.observations, data.actions, data.starts)
    student = STUDENTS[kind]
    return student.fit(samples, settings or student.settings, seed=0, n_jobs=1)


def test_open_loop_is_the_mean_of_each_moment(generator):
    names = load_expert("trot").observation_names
    observations = np.zeros((300, len(names)))
    state, iteration = generator.integers(2, size=300), generator.integers(4, size=300)
    observations[np.arange(300), names.index("RM State 0") + state] = 1.0
    observations[:, names.index("RM Iters")] = 0.1 * iteration
    actions = generator.normal(size=(300, 12))
    dataset = Dataset(observations, actions, np.ones(300, dtype=np.int64))
    policy = fit("open_loop", names, dataset)
    expected = actions[(state == 1) & (iteration == 2)].mean(axis=0)
    np.testing.assert_allclose(policy.table[1, 2], expected)
    np.testing.assert_array_equal(policy.table[1, 3], policy.table[1, 15])


def test_statewise_formulas_are_fitted_to_their_states(generator):
    names = load_expert("trot").observation_names
    observations = generator.normal(size=(400, len(names)))
    state = generator.integers(2, size=400)
    observations[:, names.index("RM State 0") : names.index("RM State 0") + 2] = np.eye(2)[state]
    sign = np.where(state == 0, 1.0, -1.0)[:, None]
    actions = sign * observations[:, 2:14] + np.roll(observations[:, 2:14], 1, axis=1)
    dataset = Dataset(observations, actions, np.ones(400, dtype=np.int64))
    settings = SymbolicSettings(population=20, generations=2, shapes=((10, 20),))
    policy = fit("statewise_symbolic", names, dataset, settings)
    assert r2_scores(policy, dataset).min() > 0.99


def test_r2_is_scikit_learns(generator):
    observations = generator.normal(size=(200, 49))
    actions = observations[:, :12] + 0.3 * generator.normal(size=(200, 12))
    dataset = Dataset(observations, actions, np.ones(200, dtype=np.int64))
    policy = fit("linear", load_expert("trot").observation_names, dataset)
    expected = r2_score(actions, policy(observations), multioutput="raw_values")
    np.testing.assert_allclose(r2_scores(policy, dataset), expected)
