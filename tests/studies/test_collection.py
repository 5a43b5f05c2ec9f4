"""The samples of a round: whose actions they hold, and that all are finite."""

from copy import copy
from dataclasses import replace

import numpy as np
import pytest

from glassgait.diagrams.scenario import Scenario
from glassgait.models.errors import InputError
from glassgait.models.policies.controller import AlternatingController, alone
from glassgait.models.task.gait import load_gait
from glassgait.studies.distillation.collection import collect
from glassgait.studies.distillation.students.baselines import untrained_student


def test_labels_are_the_experts_whoever_acts(expert):
    gait = load_gait("trot")
    student = untrained_student(expert)
    samples = collect(
        gait,
        AlternatingController(expert, student, period=3),
        episodes=range(1, 3),
        n_steps=20,
        speeds=np.array([0.0, 0.5]),
        worlds=Scenario(),
        generator=np.random.default_rng(0),
    )
    np.testing.assert_allclose(samples.actions, expert(samples.observations), atol=1e-12)
    previous = samples.observations[1:20, 26:38]
    acted = samples.actions[:19]
    by_expert = np.all(np.isclose(previous, acted), axis=1)
    assert by_expert.tolist() == [step % 3 == 0 for step in range(19)]


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize(
    ("network", "message"),
    [
        ("actor", "the action of FL_calf is not finite"),
        ("estimator", "Base Lin Vel Z is not finite"),
    ],
)
def test_samples_that_are_not_finite_are_refused(expert, network, message):
    own = getattr(expert, network)
    last = own.network.biases[-1].copy()
    last[2] = np.nan
    inner = replace(own.network, biases=(*own.network.biases[:-1], last))
    broken = copy(expert)
    # An estimator is a property, which other policies are given.
    name = "_estimator" if network == "estimator" else network
    setattr(broken, name, replace(own, network=inner))
    with pytest.raises(InputError, match=f"{message} at control step 0 of its episode"):
        collect(
            load_gait("trot"),
            alone(broken),
            episodes=range(1, 3),
            n_steps=3,
            speeds=np.array([0.0, 0.5]),
            worlds=Scenario(),
            generator=np.random.default_rng(0),
        )
