"""Policies of several gaits as one."""

from dataclasses import replace

import numpy as np
import pytest

from glassgait.models.errors import InputError
from glassgait.models.policies.controller import AlternatingController, alone
from glassgait.models.policies.library import load_expert, load_student
from glassgait.models.policies.switched import SwitchedPolicy
from glassgait.models.robots.joint_law import JointLaw
from glassgait.models.robots.target_limits import TargetLimits
from glassgait.models.task.gait import load_gait
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.models.task.observation import ObservationLayout
from glassgait.models.task.odometry import Odometry

NAMES = ("walk", "trot")


@pytest.fixture(scope="module")
def switch():
    return GaitSwitch([load_gait(name) for name in NAMES])


@pytest.fixture(scope="module")
def walkers():
    """The walk's page of formulas, and the trot's expert."""
    page = alone(load_student("walk", "sparse_formula"), load_expert("walk"))
    return [page, alone(load_expert("trot"))]


@pytest.fixture(scope="module")
def learners(switch, make_learned_expert):
    """Experts that estimate by a network each, and observe no IMU."""
    return [alone(make_learned_expert(gait)) for gait in switch.gaits]


def observations(switch, generator, *, imu):
    """Draws an observation in every state, and what each gait's own policy would be shown."""
    size = ObservationLayout(0, imu=imu).size
    before = size - 9  # two numbers of steps and seven estimates stand behind the state
    rest = generator.normal(size=(switch.n_states, size))
    whole, own, row = [], [], 0
    for gait in switch.gaits:
        for state in np.eye(gait.n_states):
            head, tail = rest[row, :before], rest[row, before:]
            whole.append(np.concatenate([head, np.eye(switch.n_states)[row], tail]))
            own.append(np.concatenate([head, state, tail]))
            row += 1
    return np.array(whole), own


def test_each_gaits_policy_sees_its_own_states_alone(switch, walkers, generator):
    policy = SwitchedPolicy(switch, walkers, greatest_change=1e9)
    assert policy.observation_names == ObservationLayout(6, imu=True).names
    assert isinstance(policy.estimator, Odometry)
    whole, own = observations(switch, generator, imu=True)
    actions = policy(whole)
    for i, seen in enumerate(own):
        walker = walkers[0] if i < 4 else walkers[1]
        np.testing.assert_allclose(actions[i], walker.policy(seen), atol=1e-12)


def test_each_gaits_estimator_sees_its_own_states_alone(switch, learners, generator):
    policy = SwitchedPolicy(switch, learners, greatest_change=1e9)
    assert policy.observation_names == ObservationLayout(6).names
    whole, own = observations(switch, generator, imu=False)
    actions, estimates = policy(whole), policy.estimator(whole[:, :-7])
    for i, seen in enumerate(own):
        learner = learners[0] if i < 4 else learners[1]
        np.testing.assert_allclose(actions[i], learner.policy(seen), atol=1e-12)
        np.testing.assert_allclose(estimates[i], learner.estimator(seen[:-7]), atol=1e-12)


def test_shapes_are_those_of_any_policy(switch, walkers, learners, generator):
    policy = SwitchedPolicy(switch, walkers)
    whole, _ = observations(switch, generator, imu=True)
    np.testing.assert_allclose(policy(whole[5]), policy(whole)[5], atol=1e-12)
    assert policy(whole.reshape(2, 3, -1)).shape == (2, 3, 12)
    sensed = observations(switch, generator, imu=False)[0][:, :-7].reshape(2, 3, -1)
    assert SwitchedPolicy(switch, learners).estimator(sensed).shape == (2, 3, 7)


def test_an_action_goes_toward_the_policys_as_far_as_a_step_may(switch, learners, generator):
    free, bounded = (SwitchedPolicy(switch, learners, change) for change in (1e9, 2.0))
    whole, _ = observations(switch, generator, imu=False)
    previous = whole[:, 26:38]
    wanted, taken = free(whole) - previous, bounded(whole) - previous
    length = np.sqrt(np.sum(wanted**2, axis=1, keepdims=True))
    assert np.all(length**2 > 2.0)
    np.testing.assert_allclose(taken, np.sqrt(2.0) * wanted / length, atol=1e-12)
    # One that is near enough is taken as it is.
    near = whole.copy()
    for _ in range(100):
        near[:, 26:38] = bounded(near)
    np.testing.assert_array_equal(bounded(near), free(near))


def test_digests_differ_by_policy_estimator_and_order(switch, walkers):
    trot, walk = (alone(load_expert("trot")), alone(load_expert("walk")))
    digests = {
        SwitchedPolicy(switch, walkers).digest(),
        SwitchedPolicy(switch, [walk, trot]).digest(),
        SwitchedPolicy(GaitSwitch(switch.gaits[::-1]), [trot, walk]).digest(),
    }
    assert len(digests) == 3


def test_what_cannot_act_is_refused(switch, walkers, learners, make_policy, tmp_path):
    walk, trot = walkers
    with pytest.raises(InputError, match="1 policies"):
        SwitchedPolicy(switch, [walk])
    with pytest.raises(InputError, match="trot"):
        SwitchedPolicy(switch, [trot, trot])
    blind = alone(make_policy(load_gait("trot")))
    with pytest.raises(InputError, match="has no estimator"):
        SwitchedPolicy(switch, [learners[0], blind])
    turns = AlternatingController(walk.expert, walk.student, period=2)
    with pytest.raises(InputError, match="by turns"):
        SwitchedPolicy(switch, [turns, trot])
    firm = alone(trot.policy.with_joint_law(JointLaw((60.0, 1.0))), trot.expert)
    with pytest.raises(InputError, match="different gains"):
        SwitchedPolicy(switch, [walk, firm])
    law = trot.policy.joint_law
    loose = alone(trot.policy.with_joint_law(replace(law, limits=TargetLimits(40.0, margin=0.05))))
    with pytest.raises(InputError, match="different limits"):
        SwitchedPolicy(switch, [walk, loose])
    free = alone(trot.policy.with_joint_law(replace(law, limits=None)))
    assert SwitchedPolicy(switch, [walk, free]).joint_law == walk.joint_law
    with pytest.raises(InputError, match="has no file"):
        SwitchedPolicy(switch, walkers).save(tmp_path / "policy.safetensors")


@pytest.mark.parametrize("count", [1, 2])
def test_its_machine_is_that_of_its_gaits(switch, walkers, count):
    """Of a single gait too, whose states have other names there than alone."""
    own = GaitSwitch(switch.gaits[:count])
    policy = SwitchedPolicy(own, walkers[:count])
    policy.refuse_other_machine(own.gait)
    with pytest.raises(InputError, match="differs in 'states'"):
        policy.refuse_other_machine(switch.gaits[0])
