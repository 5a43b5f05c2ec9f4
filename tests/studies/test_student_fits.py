"""Single fits of students, each to a law that it must find, and their scores."""

import numpy as np
import pytest
from sklearn.metrics import r2_score

from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.formulas.reader import read_formulas
from glassgait.models.policies.library import load_expert
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.observation import ObservationLayout, indices_of
from glassgait.studies.distillation.students.baselines import OSCILLATOR
from glassgait.studies.distillation.students.dataset import Dataset, r2_scores
from glassgait.studies.distillation.students.registry import STUDENTS
from glassgait.studies.distillation.students.student import TrainingSet
from glassgait.studies.distillation.students.symbolic_regression import StatewiseSymbolicSettings


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
    settings = StatewiseSymbolicSettings(population=20, generations=2, shapes=((10, 20),))
    policy = fit("statewise_symbolic", names, dataset, settings)
    assert r2_scores(policy, dataset).min() > 0.99


def test_r2_is_scikit_learns(generator):
    names = load_expert("trot").observation_names
    observations = generator.normal(size=(200, len(names)))
    actions = observations[:, :12] + 0.3 * generator.normal(size=(200, 12))
    dataset = Dataset(observations, actions, np.ones(200, dtype=np.int64))
    policy = fit("linear", names, dataset)
    expected = r2_score(actions, policy(observations), multioutput="raw_values")
    np.testing.assert_allclose(r2_scores(policy, dataset), expected)


A1 = load_robot()


def samples_of_a_clock(n_states, generator, count=600):
    """Observations of all moments of a cycle, and actions that follow a sine of it."""
    names = ObservationLayout(n_states).names
    observations = generator.normal(size=(count, len(names)))
    state = generator.integers(n_states, size=count)
    observations[:, list(indices_of("machine state", names))] = np.eye(n_states)[state]
    ((time,), (whole,)) = (
        indices_of(group, names) for group in ("iterations", "commanded iterations")
    )
    scale = RobotUnits.of(A1, names).scale
    lasted, asked = generator.integers(0, 8, size=count), generator.integers(6, 11, size=count)
    observations[:, time] = lasted * scale[time]
    observations[:, whole] = asked * scale[whole]
    angle = 2.0 * np.pi * (state + lasted / asked) / n_states
    own = np.arange(quadruped.N_JOINTS)
    actions = own + np.outer(np.sin(angle), 0.1 * own) + np.outer(np.cos(angle), 0.5 - 0.1 * own)
    starts = np.zeros(count, dtype=bool)
    return TrainingSet("hop", names, observations, actions, starts)


@pytest.mark.parametrize("n_states", [2, 3, 4])
def test_sines_of_the_clock_are_found(n_states, generator):
    samples = samples_of_a_clock(n_states, generator)
    policy = OSCILLATOR.fit(samples, OSCILLATOR.settings, seed=0, n_jobs=1)
    assert isinstance(policy, FormulaPolicy)
    assert policy.n_terms() <= 36
    error = A1.action_scale * (policy(samples.observations) - samples.actions)
    assert np.abs(error).max() < 0.02
    text = policy.to_text()
    assert FormulaPolicy.from_file(read_formulas(text)).to_text() == text


def test_no_sensor_counts_but_the_machine(generator):
    samples = samples_of_a_clock(2, generator)
    policy = OSCILLATOR.fit(samples, OSCILLATOR.settings, seed=0, n_jobs=1)
    others = samples.observations.copy()
    groups = ("machine state", "iterations", "commanded iterations")
    kept = {index for group in groups for index in indices_of(group, samples.observation_names)}
    changed = [index for index in range(others.shape[1]) if index not in kept]
    others[:, changed] += generator.normal(size=(len(others), len(changed)))
    np.testing.assert_array_equal(policy(others), policy(samples.observations))
