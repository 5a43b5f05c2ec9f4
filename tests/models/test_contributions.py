"""Targets split into terms: they add up, have names, and follow their slopes."""

import numpy as np
import pytest

from glassgait.models.errors import InputError
from glassgait.models.formulas.grammar import parse_expression, parse_formula, variable_names
from glassgait.models.formulas.quantities import Vocabulary, known_definitions
from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.symbolic import SymbolicPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.observation import ObservationLayout

A1 = load_robot()


NAMES = ObservationLayout(2).names
N = len(NAMES)


def test_contributions_add_up_to_the_target(
    linear, statewise, symbolic, statewise_symbolic, additive_models, samples
):
    observations, _ = samples(5, seed=7)
    additive = AdditivePolicy.compile("trot", NAMES, additive_models)
    for policy in (linear, statewise, symbolic, statewise_symbolic, additive):
        targets = A1.joint_targets(policy(observations))
        for joint in (0, 5, 11):
            parts = policy.explain(observations, joint)
            assert parts.values.shape == (5, len(parts.terms))
            np.testing.assert_allclose(
                parts.values.sum(axis=1), targets[:, joint], rtol=0, atol=1e-9
            )
            single = policy.explain(observations[2], joint)
            assert single.terms == parts.terms
            np.testing.assert_allclose(single.values, parts.values[2], rtol=0, atol=1e-12)
    assert parts.terms[-1].count("&") == 1


def test_terms_are_written_as_in_the_file():
    vocabulary = Vocabulary(NAMES, known_definitions(A1, NAMES))
    text = "late*(0.25*cmd.v - cmd.yaw*2) + 0.125*q.FL_hip"
    formula = parse_formula(text, vocabulary.symbols)
    definitions = vocabulary.definitions
    policy = SymbolicPolicy("trot", NAMES, [formula] * quadruped.N_JOINTS, definitions=definitions)
    terms = policy.explain(np.zeros(len(NAMES)), 0).terms
    assert terms == ("late*(0.25*cmd.v)", "-late*(cmd.yaw*2)", "0.125*q.FL_hip")


def test_trees_and_networks_do_not_split_into_contributions(neural, samples):
    with pytest.raises(InputError, match="neural"):
        neural.explain(samples(1)[0][0], 0)


@pytest.mark.parametrize("kind", ["symbolic", "statewise_symbolic"])
def test_derivatives_are_the_slopes_of_the_actions(kind, request, samples):
    policy, step = request.getfixturevalue(kind), 1e-6
    observations, _ = samples(4, seed=7)
    derivatives = policy.derivatives(observations)
    assert derivatives.shape == (4, 12, N)
    for variable in (0, 3, 8):
        nudge = step * np.eye(N)[variable]
        slope = (policy(observations + nudge) - policy(observations - nudge)) / (2 * step)
        np.testing.assert_allclose(derivatives[..., variable], slope, atol=1e-6)


def test_joints_are_explained_by_name_or_index(
    linear, statewise, symbolic, statewise_symbolic, small_additive, small_trees, neural, samples
):
    observation = samples(1)[0][0]
    for policy in (linear, statewise, symbolic, statewise_symbolic, small_additive()):
        named, numbered = policy.explain(observation, "FL_calf"), policy.explain(observation, 2)
        assert named.terms == numbered.terms
        np.testing.assert_array_equal(named.values, numbered.values)
    for policy in (linear, small_trees(), neural):
        for bad in ("FL_knee", 12, -1, True):
            with pytest.raises(InputError, match="unknown joint"):
                policy.explain(observation, bad)


def test_products_of_many_sums_are_explained_in_one_term(samples):
    product = " * ".join(f"(x{i} + {i}.5)" for i in range(22))
    formula = parse_expression(f"x0 + {product}", variable_names(N))
    policy = SymbolicPolicy("trot", NAMES, [formula] * quadruped.N_JOINTS)
    observations, _ = samples(5)
    parts = policy.explain(observations, "FL_calf")
    assert len(parts.terms) == 2
    targets = A1.joint_targets(policy(observations))
    np.testing.assert_allclose(parts.values.sum(axis=1), targets[:, 2])
