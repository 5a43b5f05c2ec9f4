"""Numbers of formula files: where they stand, and policies that act by others."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glassgait.models.errors import InputError
from glassgait.models.formulas.expression import ZERO, canonical
from glassgait.models.formulas.numbers import (
    FileNumbers,
    WeightedSum,
    numbers_of,
    with_numbers,
)
from glassgait.models.formulas.reader import read_formulas
from glassgait.models.formulas.tape import Tape
from glassgait.models.formulas.text import parse_formula
from glassgait.models.policies.adjustable import AdjustablePolicy
from glassgait.models.policies.library import load_student
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.task.observation import machine_state_entries


@pytest.fixture(scope="module")
def trot():
    return load_student("trot", "sparse_formula")


@pytest.fixture
def observed(trot):
    names = trot.observation_names
    observations = np.random.default_rng(3).normal(size=(40, len(names)))
    observations[:, machine_state_entries(names)] = np.eye(2)[np.arange(40) % 2]
    return observations


def test_numbers_stand_from_left_to_right():
    formula = parse_formula("0.5 - 0.25*a + tanh(2*b - 3)", ("a", "b"))
    assert [*numbers_of(formula)] == [0.5, 0.25, 2.0, 3.0]
    again = canonical(with_numbers(formula, iter([0.5, -0.25, 2.0, 3.0])))
    assert again == parse_formula("0.5 + 0.25*a + tanh(2*b - 3)", ("a", "b"))


@pytest.mark.parametrize(
    ("text", "terms", "rest"),
    [
        ("0.5 - 0.25*a + 3*tanh(b)", ["1", "-a", "tanh(b)"], "0"),
        ("a*(0.5 + 2*b) - 0.1/b", ["a", "a*b", "-(1/b)"], "0"),
        ("-(0.5 + a) + (b - 2)*b", ["1", "-b"], "-a + b*b"),
        ("a + sin(b)/a", [], "a + sin(b)/a"),
    ],
)
def test_what_each_number_multiplies(text, terms, rest):
    formula = parse_formula(text, ("a", "b"))
    own = WeightedSum.of(formula)
    assert own is not None and len(own.terms) == len(terms)
    points = np.random.default_rng(1).uniform(0.5, 2.0, (20, 2))
    expected = [parse_formula(term, ("a", "b")) for term in (*terms, rest)]
    values = Tape([*own.terms, own.rest], 2)(points)
    np.testing.assert_allclose(values, Tape(expected, 2)(points), atol=1e-12)
    whole = values @ np.array([*numbers_of(formula), 1.0])
    np.testing.assert_allclose(whole, Tape([formula], 2)(points)[:, 0], atol=1e-12)


@pytest.mark.parametrize("text", ["tanh(2*a)", "0.5*(a + 2)", "a/(b + 1)", "a + (3*b)**2"])
def test_numbers_that_are_no_weights(text):
    assert WeightedSum.of(parse_formula(text, ("a", "b"))) is None


@pytest.mark.parametrize("kind", ["sparse_formula", "statewise_symbolic"])
def test_formulas_that_ship_are_weighted_sums(kind):
    for formula in load_student("pace", kind).to_file().written().values():
        own = WeightedSum.of(formula)
        assert own is not None and own.rest == ZERO


def test_a_file_with_its_own_numbers_is_itself(trot):
    numbered = FileNumbers(trot.to_file())
    assert numbered.replaced(numbered.start) is numbered.file
    assert FormulaPolicy.from_file(numbered.replaced(numbered.start)).to_text() == trot.to_text()


def test_a_number_changes_one_line_and_its_mirror_image(trot):
    numbered = FileNumbers(trot.to_file())
    numbers = list(numbered.start)
    index = numbers.index(0.0624)
    numbers[index] = 0.07
    text = FormulaPolicy.from_file(numbered.replaced(numbers)).to_text()
    pairs = zip(trot.to_text().splitlines(), text.splitlines(), strict=True)
    (changed,) = [(old, new) for old, new in pairs if old != new]
    assert changed[1] == changed[0].replace("0.0624", "0.07")
    numbers[index] = numbered.start[index]
    assert FormulaPolicy.from_file(numbered.replaced(numbers)).to_text() == trot.to_text()


def test_what_is_multiplied_by_zero_leaves_the_file(trot):
    numbered = FileNumbers(trot.to_file())
    numbers = [0.0 if number == 0.0624 else number for number in numbered.start]
    text = FormulaPolicy.from_file(numbered.replaced(numbers)).to_text()
    assert "FL_hip = 0.324 + 0.146*q.FL_hip" in text
    assert read_formulas(text) == numbered.replaced(numbers)


def test_other_counts_of_numbers_are_refused(trot):
    numbered = FileNumbers(trot.to_file())
    with pytest.raises(InputError, match="the file has"):
        numbered.replaced(numbered.start[1:])


@settings(max_examples=settings.default.max_examples // 10)
@given(st.data())
def test_an_adjusted_policy_acts_as_its_file_does(trot, data):
    adjustable = AdjustablePolicy(trot)
    numbers = list(adjustable.numbers)
    for _ in range(5):
        index = data.draw(st.integers(0, len(numbers) - 1))
        numbers[index] = data.draw(st.sampled_from([0.0, -0.5, 0.3, 2.0, -numbers[index]]))
    adjustable.adjust(numbers)
    policy = adjustable.to_policy()
    read = FormulaPolicy.from_file(read_formulas(policy.to_text()), trot.robot)
    assert adjustable.digest() == policy.digest() == read.digest()
    names = trot.observation_names
    observations = np.random.default_rng(3).normal(size=(12, len(names)))
    observations[:, machine_state_entries(names)] = np.eye(2)[np.arange(12) % 2]
    one_by_one = np.array([adjustable(one) for one in observations])
    np.testing.assert_array_equal(one_by_one, [policy(one) for one in observations])
    np.testing.assert_array_equal(adjustable(observations), policy(observations))


def test_what_is_infinite_is_left_out_by_a_zero_before_it(trot, observed):
    """`0.001*(1/(v.x - v.x))` is infinite, and 0 times that is no number."""
    file = trot.to_file()
    symbols = file.vocabulary.symbols
    infinite = parse_formula("0.3 + 0.001*(1/(dq.FL_hip - dq.FL_hip))", symbols)
    formulas = {place: parse_formula("0.3", symbols) for place in file.formulas}
    formulas = formulas | {place: infinite for place in formulas if place[-1] == 1}
    policy = FormulaPolicy.from_file(replace(file, formulas=formulas, mirror=None), trot.robot)
    adjustable = AdjustablePolicy(policy)
    assert not np.isfinite(adjustable(observed)).all()
    adjustable.adjust([0.0 if own == 0.001 else own for own in adjustable.numbers])
    acted = adjustable(observed)
    assert np.isfinite(acted).all()
    np.testing.assert_array_equal(acted, adjustable.to_policy()(observed))
    np.testing.assert_array_equal(adjustable(observed[0]), acted[0])
    adjustable.adjust(adjustable.numbered.start)
    assert not np.isfinite(adjustable(observed)).all()


def test_an_adjustable_policy_begins_as_the_policy_it_is_made_of(trot, observed):
    adjustable = AdjustablePolicy(trot)
    np.testing.assert_array_equal(adjustable(observed), trot(observed))
    assert adjustable.digest() == trot.digest()
    assert adjustable.joint_law == trot.joint_law
    assert adjustable.estimator is trot.estimator
    assert adjustable.observes_by == trot.observes_by
    assert adjustable.machine == trot.machine


def test_policies_with_one_formula_for_every_state_are_adjusted_too(trot, observed):
    file = trot.to_file()
    shared = {(joint,): file.formulas[0, joint] for joint in range(12)}
    policy = FormulaPolicy.from_file(replace(file, formulas=shared, mirror=None), trot.robot)
    adjustable = AdjustablePolicy(policy)
    np.testing.assert_array_equal(adjustable(observed), policy(observed))


@pytest.mark.parametrize("wrong", [lambda own: own[1:], lambda own: (np.nan, *own[1:])])
def test_wrong_numbers_are_refused(trot, wrong):
    adjustable = AdjustablePolicy(trot)
    with pytest.raises(InputError, match="finite numbers"):
        adjustable.adjust(wrong(adjustable.numbers))
    assert adjustable.numbers == adjustable.numbered.start
