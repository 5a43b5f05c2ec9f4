"""Oscillators: 36 numbers of a clock."""

import numpy as np
import pytest

from glassgait.models.formulas.file import read_formulas
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import load_robot
from glassgait.models.task.observation import ObservationLayout, indices_of
from glassgait.studies.distillation.students.baselines import OSCILLATOR
from glassgait.studies.distillation.students.student import TrainingSet

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
