"""The samples of a round: whose actions they hold, and that all are finite."""

from copy import copy
from dataclasses import replace

import numpy as np
import pytest

from glassgait.diagrams import batch
from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.domain_randomization import DomainRandomization
from glassgait.diagrams.scenario import Scenario
from glassgait.models.errors import InputError
from glassgait.models.policies.controller import Controller, alone
from glassgait.models.task.gait import load_gait
from glassgait.models.task.observation import indices_of
from glassgait.studies.distillation import collection
from glassgait.studies.distillation.collection import collect
from glassgait.studies.distillation.linear import untrained_student


def test_labels_are_the_experts_whoever_acts(expert):
    gait = load_gait("trot")
    student = untrained_student(expert)
    samples = collect(
        gait,
        Controller(expert, student, period=3),
        episodes=range(1, 3),
        n_steps=20,
        worlds=Scenario(),
        generator=np.random.default_rng(0),
    )
    np.testing.assert_allclose(samples.actions, expert(samples.observations), atol=1e-12)
    entries = indices_of("previous action", expert.observation_names)
    previous = samples.observations[1:20, entries]
    acted = expert.robot.limited_action(samples.actions[:19])
    by_expert = np.all(np.isclose(previous, acted), axis=1)
    assert by_expert.tolist() == [step % 3 == 0 for step in range(19)]


@pytest.fixture
def often(monkeypatch):
    """Lets commands change every 20 control steps."""
    for module in (batch, collection):
        monkeypatch.setattr(module, "COMMAND_STEPS", 20)


def commands_of(expert, worlds, speeds=None, n_steps=22):
    """Returns the commanded speeds and yaw rates of 12 robots (12, n_steps, 2)."""
    samples = collect(
        load_gait("trot"),
        alone(expert),
        episodes=range(1, 13),
        n_steps=n_steps,
        speeds=speeds,
        worlds=worlds,
        generator=np.random.default_rng(0),
    )
    places = [expert.observation_names.index(f"Command {name}") for name in ("X", "Yaw")]
    return samples.observations[:, places].reshape(12, n_steps, 2)


WORLDS = [DomainRandomization(n_groups=2, fine_steps=()), Scenario(command=FixedCommand(speed=0.3))]


@pytest.mark.parametrize("worlds", WORLDS, ids=["randomised", "one"])
def test_speeds_are_drawn_over_the_gaits_range_and_change(expert, worlds, often):
    command = commands_of(expert, worlds)
    greatest = np.array([load_gait("trot").max_speed, load_gait("trot").max_yaw_rate])
    assert np.all(np.abs(command) <= greatest)
    first, last = command[:, 0], command[:, -1]
    assert first[:, 0].min() < -0.5 and first[:, 0].max() > 0.5
    assert np.mean(first[:, 0] != last[:, 0]) > 0.5
    np.testing.assert_array_equal(command[:, 0], command[:, 1])


def test_speeds_that_are_named_stay_while_turns_change(expert, often):
    command = commands_of(expert, Scenario(), np.array([0.0, 0.25, 0.5]))
    speeds = np.tile([0.0, 0.25, 0.5], 4)
    np.testing.assert_array_equal(command[..., 0], np.broadcast_to(speeds[:, None], (12, 22)))
    assert np.all(command[:, 0, 1] != command[:, -1, 1])


def test_as_many_go_straight_as_the_worlds_ask_for(expert):
    worlds = replace(WORLDS[0], randomization=replace(WORLDS[0].randomization, straight=1.0))
    command = commands_of(expert, worlds, n_steps=2)
    assert not command[..., 1].any() and command[..., 0].any()


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize(
    ("owner", "network"), [("expert", "actor"), ("learned_expert", "_estimator")]
)
def test_samples_that_are_not_finite_are_refused(request, owner, network):
    broken = copy(request.getfixturevalue(owner))
    own = getattr(broken, network)
    last = own.biases[-1].copy()
    last[2] = np.nan
    setattr(broken, network, replace(own, biases=(*own.biases[:-1], last)))
    with pytest.raises(InputError, match="is not finite at control step 0"):
        collect(
            load_gait("trot"),
            alone(broken),
            episodes=range(1, 3),
            n_steps=3,
            worlds=Scenario(),
            generator=np.random.default_rng(0),
        )
