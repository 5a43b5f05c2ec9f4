"""Formulas in a mirror that exchanges left and right."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glassgait.models.formulas.evaluate import Tape
from glassgait.models.formulas.expression import canonical
from glassgait.models.formulas.grammar import parse_formula, write_formula
from glassgait.models.formulas.mirror import FormulaMirror
from glassgait.models.formulas.quantities import Definition, Vocabulary, known_definitions
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.observation import (
    MIRRORED_LEGS,
    REFLECT_JOINTS,
    ObservationLayout,
    reflect_observation,
)

A1 = load_robot()


NAMES = ObservationLayout(2).names
N = len(NAMES)
VOCABULARY = Vocabulary(NAMES, known_definitions(A1, NAMES))
TROT = FormulaMirror.of(VOCABULARY, (1, 0))
BOUND = FormulaMirror.of(VOCABULARY, (0, 1))

HIP, THIGH = (quadruped.JOINTS.index(joint) for joint in ("FL_hip", "FL_thigh"))


def image(text, joint):
    formula = parse_formula(text, VOCABULARY.symbols)
    return write_formula(TROT.formula(formula, joint), VOCABULARY.symbols)


@given(st.data(), st.sampled_from([TROT, BOUND]), st.sampled_from([HIP, THIGH]))
def test_the_image_of_the_image_is_the_formula(random_formulas, data, mirror, joint):
    formula = canonical(data.draw(random_formulas(len(VOCABULARY.symbols))))
    other = mirror.formula(formula, joint)
    assert canonical(other) == other
    (place,) = mirror.place((joint,))
    assert mirror.formula(other, place) == formula


def _divisors(formula):
    """Lists the divisors in a formula."""
    own = [formula.operands[1]] if formula.operator == "div" else []
    return own + [divisor for operand in formula.operands for divisor in _divisors(operand)]


@given(
    data=st.data(),
    states=st.sampled_from([(1, 0), (0, 1)]),
    joint=st.sampled_from([HIP, THIGH]),
    seed=st.integers(0, 2**32 - 1),
)
def test_an_image_is_worth_what_the_formula_is_in_the_mirror(
    random_formulas, data, states, joint, seed
):
    observed = Vocabulary(NAMES)
    formula = canonical(data.draw(random_formulas(N)))
    other = FormulaMirror.of(observed, states).formula(formula, joint)
    quantities = np.random.default_rng(seed).normal(size=(9, N))
    own = Tape([formula], N)(reflect_observation(NAMES, states)(quantities))
    found = Tape([other], N)(quantities)
    # Canonical form may change the sign of a zero, and so of a quotient by it.
    sound = (Tape(_divisors(formula), N)(quantities) != 0.0).all(axis=1)
    expected = own * REFLECT_JOINTS.sign[joint]
    np.testing.assert_array_equal(found[sound], expected[sound])


@pytest.mark.parametrize(
    ("joint", "text", "other"),
    [
        (THIGH, "0.1 + 0.5*q.FL_thigh", "0.1 + 0.5*q.FR_thigh"),
        (THIGH, "late*(a.RL_calf - 0.2*cmd.yaw)", "late*(a.RR_calf + 0.2*cmd.yaw)"),
        (THIGH, "lifted.FL - x.RR + z.FR", "lifted.FR - x.RL + z.FL"),
        (THIGH, "s0 - v.x + v.y*v.z", "s1 - v.x - v.y*v.z"),
        (THIGH, "t/cmd.t - cmd.v*e.v*phase", "t/cmd.t - cmd.v*e.v*phase"),
        (THIGH, "h.FL*q.FL_hip*q.FR_hip", "h.FR*q.FR_hip*q.FL_hip"),
        (THIGH, "sin(q.RL_hip)", "sin(-q.RR_hip)"),
        (HIP, "0.1 + 0.5*q.FL_thigh", "-0.1 - 0.5*q.FR_thigh"),
        (HIP, "0.5*q.FL_hip - dq.RR_hip", "0.5*q.FR_hip - dq.RL_hip"),
        (HIP, "cmd.yaw", "cmd.yaw"),
    ],
)
def test_left_and_right_change_places_and_hips_turn_the_other_way(joint, text, other):
    assert image(text, joint) == other
    assert image(other, joint) == text


def test_an_image_stands_at_the_other_sides_joint_in_the_states_image():
    for joint, name in enumerate(quadruped.JOINTS):
        leg, kind = name.split("_")
        index = quadruped.JOINTS.index(f"{MIRRORED_LEGS[leg]}_{kind}")
        assert TROT.place((joint,)) == (index,)
        assert TROT.place((0, joint)) == (1, index)
        assert BOUND.place((1, joint)) == (1, index)
        assert TROT.place(TROT.place((0, joint))) == (0, joint)


def defined(*texts):
    symbols = Vocabulary(NAMES).symbols
    definitions = [Definition(f"d{i}", parse_formula(t, symbols)) for i, t in enumerate(texts)]
    return Vocabulary(NAMES, tuple(definitions))


def test_a_definition_may_be_its_own_image_or_the_negative_of_one():
    vocabulary = defined("v.y*t", "q.FL_hip", "-q.FR_hip", "3*v.y - 2*cmd.yaw", "tanh(t)")
    mirror = FormulaMirror.of(vocabulary, (1, 0))
    text = "d0 + 2*d1 + 3*d2 + 4*d3 + 5*d4"
    formula = mirror.formula(parse_formula(text, vocabulary.symbols), THIGH)
    assert write_formula(formula, vocabulary.symbols) == "-d0 + 2*d2 + 3*d1 - 4*d3 + 5*d4"
