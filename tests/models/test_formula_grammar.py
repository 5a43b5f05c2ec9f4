"""The package and the certificate checker read the same formulas from a file, or both refuse it."""

import re

import numpy as np
import pytest

from glassgait.models.certificates.checker import RefusedError
from glassgait.models.certificates.checker.policy import FormulaFile
from glassgait.models.errors import InputError
from glassgait.models.formulas.evaluate import Tape
from glassgait.models.formulas.reader import read_formulas
from glassgait.models.policies.library import STUDENT_DIRECTORY, load_policy
from glassgait.models.robots import quadruped

SMALL = """format: 2
gait: trot
states: 2
mirror: [1, 0]
machine:
  description: Diagonal pairs of feet take turns.
  max_speed: 1.0
  max_yaw_rate: 1.0
  dwell: [6, 11]
  clearance: 0.03
  states: [q0, q1]
  initial: q0
  transitions:
    - {from: q0, to: q1, when: FL & RR & ~FR & ~RL}
    - {from: q1, to: q0, when: FR & RL & ~FL & ~RR}

# Two halves of a stride.
definitions
late = tanh(0.5*t - 2)    # -1 as a state begins
lifted.FL = tanh(100*h.FL - 2)
lifted.FR = tanh(100*h.FR - 2)

state 0
FL_hip = 0.0152 + 0.215*q.RR_hip - lifted.FL*(0.0468*cmd.yaw + 0.245*v.y)
    - .5*late**2
FL_thigh = 5.89e-1 - -0.0157*dq.FL_thigh
FL_calf = -1.62 + 0.218*cmd.v/(2 + q.FL_hip**2)
FR_hip = -0.265
FR_thigh = tanh(2 + cos(q.FR_thigh))
FR_calf = 1/(2 + h.FR*h.FR) - 1
RL_hip = late*late*late
RL_thigh = (cmd.v - v.x)*(0.1 + lifted.FR)
RL_calf = ((q.FL_hip))
RR_hip = 0.1*s0
RR_thigh = 0.3*(3 + sin(t))
RR_calf = 2*(h.RL - 1)**3
"""

SHARED = re.sub(r"mirror.*\n", "", SMALL).replace("state 0", "every state")

PAGE = (STUDENT_DIRECTORY / "trot" / "formulas.formulas").read_text()
WHOLE = PAGE[: PAGE.index("\n\n") + 1] + SMALL[SMALL.index("\ndefinitions") :]
WHOLE = WHOLE.replace("lifted.FR = tanh(100*h.FR - 2)\n", "")
"""A whole controller, with a definition whose mirror image is left out."""

ALPHABET = [
    *"0123456789.+-*/()=# \n_eqt,:;[]'\\^",
    *("\t", "\r", "\f", "\v", "\x1c", "\x85", "\xa0", "\u2028", "\u2029", "\ufeff", "\x00", "\x7f"),
    *("\uff11", "\u0430", "\u2212"),
]
TITLES = ("\nstate 1\n", "\nstate 0\n", "\nevery state\n", "\ndefinitions\n", "\n\n", "\n ")
LINES = (
    *("\n    + t", "\nFL_hip = 50*q.FL_hip + 9\n", "\u2028state 1\u2028FL_hip = 9\u2028"),
    *("\rFL_hip = 9\r", "lambda = t\n", "q.FL_hip = t\n", "FL_hip = t\n", "late = t\n"),
    *("FL_hip == t\n", "mirror: [0, 1]\n", "mirror: [1, 0]\n", "states: 3\n", "format: 2\n"),
    *("gait: trot\n", "x = t\n"),
)
SIGNS = "# **2 **3 **(2) **2.0 **-2 // *- -- +-+ ( ) () ' { [ !! *a yes << ~ .nan 1.0e+2"
NUMBERS = "0x10 1_000 007 00 1e400 1e-400 1. .5 1e5 2j 2t . t.real late.x 2026-01-01"
WORDS = (
    *SIGNS.split(),
    *NUMBERS.split(),
    *("** 2", "1" * 40, "sin (t)", "sin\n (t)", "(q).FL_hip", "q. FL_hip", "q .FL_hip", ": "),
    *("(sin)(t)", "sin", "sin(t, t)", " if t else t", " and t", "not t", "lambda: t", "- "),
    *("True", "None", "print", "'t'", "? ", "&a "),
)
FRAGMENTS = (*TITLES, *LINES, *WORDS)


def mutated(text: str, generator: np.random.Generator) -> str:
    """Changes a text in one to three places."""
    for _ in range(generator.integers(1, 4)):
        place, lines = int(generator.integers(len(text) + 1)), text.split("\n")
        first, second = generator.integers(len(lines), size=2).tolist()
        match generator.integers(6):
            case 0:
                text = text[:place] + str(generator.choice(ALPHABET)) + text[place:]
            case 1:
                text = text[:place] + text[place + int(generator.integers(1, 4)) :]
            case 2 | 3:
                text = text[:place] + str(generator.choice(FRAGMENTS)) + text[place:]
            case 4:
                lines.insert(first, lines[second])
                text = "\n".join(lines)
            case 5:
                lines[first] += (
                    "#" if generator.random() < 0.3 else str(generator.choice(FRAGMENTS))
                )
                text = "\n".join(lines)
    return text


class Numbers:
    """Floating-point arithmetic with which the checker evaluates formulas."""

    def __init__(self, quantities: dict[str, float]) -> None:
        self.quantities, self.known = quantities, {}

    def number(self, value):
        return np.float64(value)

    def quantity(self, name):
        return np.float64(self.quantities[name])

    def product(self, a, b):
        return a * b

    def quotient(self, a, b):
        return a / b

    def function(self, name, a):
        return getattr(np, name)(a)


def seen_by_robots(text: str):
    """Returns the values of each state's and joint's formula, and the quantities used."""
    file = read_formulas(text)
    symbols = file.vocabulary.symbols
    n = len(file.vocabulary.names)
    points = np.random.default_rng(0).normal(size=(3, n))
    n_states = sum(name.startswith("RM State") for name in file.vocabulary.names)
    found = {}
    for place, formula in file.formulas.items():
        values = Tape([file.vocabulary.expanded(formula)], n)(points)[:, 0]
        for state in [place[0]] if len(place) == 2 else range(n_states):
            found[state, quadruped.JOINTS[place[-1]]] = values
    return found, [dict(zip(symbols[:n], own.tolist(), strict=True)) for own in points]


def assert_seen_alike(text: str) -> bool:
    """Compares the formulas of both readers; returns whether the text is valid."""
    try:
        expected, points = seen_by_robots(text)
    except InputError as error:
        # A refusal names the place; the checker need not refuse, since no robot uses this file.
        place = re.match(r"line (\d+), column (\d+): .", str(error))
        assert place and 1 <= int(place[1]) <= text.count("\n") + 2, error
        assert "\n" not in str(error) and len(str(error)) < 500
        return False
    if "machine:" not in text:
        return False
    file = FormulaFile(text, [*points[0]])
    with np.errstate(all="ignore"):
        for (state, joint), values in expected.items():
            found = [file.evaluate(Numbers(point), joint, state) for point in points]
            np.testing.assert_allclose(found, values, rtol=1e-9)
    return True


def assert_all_seen_alike(seed: int, count: int) -> None:
    generator = np.random.default_rng(seed)
    read = sum(
        assert_seen_alike(mutated((SMALL, SHARED, WHOLE)[index % 3], generator))
        for index in range(count)
    )
    # Some mutations are refused, and some are not.
    assert 0.05 * count < read < 0.95 * count


def test_mutated_files_are_seen_alike():
    assert_all_seen_alike(0, 200)


@pytest.mark.slow
def test_thousands_of_mutated_files_are_seen_alike():
    assert_all_seen_alike(1, 4_000)


@pytest.mark.slow
@pytest.mark.parametrize(
    "path", sorted(STUDENT_DIRECTORY.glob("*/*.formulas")), ids=lambda path: f"{path.parent.name}"
)
def test_files_that_ship_are_seen_alike(path):
    assert assert_seen_alike(path.read_text())


@pytest.mark.parametrize(
    "sign", ["\u2028", "\u2029", "\x85", "\r", "\v", "\f", "\x1c", "\t", "\ufeff"]
)
def test_invisible_signs_are_refused_by_both_readers(sign, tmp_path):
    hidden = SMALL.replace("# Two", f"# Two{sign}state 1{sign}FL_hip = 50*q.FL_hip + 9{sign}#")
    for text in (hidden, sign + SMALL):
        with pytest.raises(InputError, match=r"line \d+, column \d+"):
            read_formulas(text)
        with pytest.raises(RefusedError):
            FormulaFile(text, ["q.FL_hip"])
        path = tmp_path / "formulas.formulas"
        path.write_bytes(text.encode())
        with pytest.raises(InputError):
            load_policy(path)


@pytest.mark.parametrize("term", ["t**2**3", "t**t", "(t)(t)", "exp(t)", "late.FL", "t//2", "1j"])
def test_a_formula_that_is_none_is_refused_by_the_checker(term):
    file = SMALL.replace("RL_calf = ((q.FL_hip))", f"RL_calf = {term}")
    assert file != SMALL
    with pytest.raises((RefusedError, ValueError, TypeError, LookupError)):
        FormulaFile(file, ["t"]).evaluate(Numbers({"t": 1.0}), "RL_calf", 0)
