"""Policies of several gaits as one."""

import numpy as np
import pytest

from glassgait.models.errors import InputError
from glassgait.models.policies.controller import AlternatingController, alone
from glassgait.models.policies.library import load_expert, load_student
from glassgait.models.policies.switched import SwitchedPolicy
from glassgait.models.robots.joint_law import JointLaw
from glassgait.models.task.gait import load_gait
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.models.task.observation import ObservationLayout

NAMES = ("walk", "trot")


@pytest.fixture(scope="module")
def switch():
    return GaitSwitch([load_gait(name) for name in NAMES])


@pytest.fixture(scope="module")
def walkers():
    """The walk's page of formulas, and the trot's expert."""
    page = alone(load_student("walk", "sparse_formula"), load_expert("walk"))
    return [page, alone(load_expert("trot"))]


def observations(switch, generator):
    """Draws an observation in every state, and what each gait's own policy would be shown."""
    n_states = [gait.n_states for gait in switch.gaits]
    rest = generator.normal(size=(switch.n_states, 47))
    whole, own, row = [], [], 0
    for count in n_states:
        for state in range(count):
            one_hot = np.eye(switch.n_states)[row]
            whole.append(np.concatenate([rest[row, :38], one_hot, rest[row, 38:]]))
            own.append(np.concatenate([rest[row, :38], np.eye(count)[state], rest[row, 38:]]))
            row += 1
    return np.array(whole), own


def test_each_gaits_policy_and_estimator_see_their_own_states_alone(switch, walkers, generator):
    policy = SwitchedPolicy(switch, walkers, greatest_change=1e9)
    assert policy.observation_names == ObservationLayout(6).names
    whole, own = observations(switch, generator)
    actions, estimates = policy(whole), policy.estimator(whole[:, :-7])
    for i, seen in enumerate(own):
        walker = walkers[0] if i < 4 else walkers[1]
        acts = walker.student or walker.expert
        np.testing.assert_allclose(actions[i], acts(seen), atol=1e-12)
        np.testing.assert_allclose(estimates[i], walker.estimator(seen[:-7]), atol=1e-12)


def test_shapes_are_those_of_any_policy(switch, walkers, generator):
    policy = SwitchedPolicy(switch, walkers)
    whole, _ = observations(switch, generator)
    np.testing.assert_allclose(policy(whole[5]), policy(whole)[5], atol=1e-12)
    assert policy(whole.reshape(2, 3, -1)).shape == (2, 3, 12)
    assert policy.estimator(whole.reshape(2, 3, -1)[..., :-7]).shape == (2, 3, 7)


def test_an_action_goes_toward_the_policys_as_far_as_a_step_may(switch, walkers, generator):
    free, bounded = (SwitchedPolicy(switch, walkers, change) for change in (1e9, 2.0))
    whole, _ = observations(switch, generator)
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


def test_what_cannot_act_is_refused(switch, walkers, make_policy, tmp_path):
    walk, trot = walkers
    with pytest.raises(InputError, match="1 policies"):
        SwitchedPolicy(switch, [walk])
    with pytest.raises(InputError, match="trot"):
        SwitchedPolicy(switch, [trot, trot])
    blind = alone(make_policy(load_gait("trot")))
    with pytest.raises(InputError, match="has no estimator"):
        SwitchedPolicy(switch, [walk, blind])
    turns = AlternatingController(walk.expert, walk.student, period=2)
    with pytest.raises(InputError, match="by turns"):
        SwitchedPolicy(switch, [turns, trot])
    firm = alone(trot.policy.with_joint_law(JointLaw((40.0, 1.0))), trot.expert)
    with pytest.raises(InputError, match="different gains"):
        SwitchedPolicy(switch, [walk, firm])
    with pytest.raises(InputError, match="has no file"):
        SwitchedPolicy(switch, walkers).save(tmp_path / "policy.safetensors")
