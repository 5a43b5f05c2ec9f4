"""The terms of a formula, each with the number that stands before it, and what it adds now."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.formulas.expression import Expression, variable
from glassgait.models.formulas.mirror import FormulaMirror, Place
from glassgait.models.formulas.numbers import FileNumbers
from glassgait.models.formulas.text import write_formula, written_number
from glassgait.models.policies.adjustable import AdjustablePolicy
from glassgait.models.policies.symbolic import factors_of
from glassgait.models.robots import quadruped
from glassgait.models.task.observation import Group, entries_of
from glassgait.models.task.symmetry import REFLECT_JOINTS, reflect_observation

GROUPS = ("constant", "command", "balance", "damping", "memory", "contact", "posture", "rhythm")
"""What a term is there for, in the order in which pages show it."""

_OF_ENTRIES: Mapping[Group, str] = {
    "commanded velocity": "command",
    "gravity": "balance",
    "angular velocity": "balance",
    "base velocity": "balance",
    "joint velocity": "damping",
    "previous action": "memory",
    "foot height": "contact",
    "joint position": "posture",
    "machine state": "rhythm",
    "iterations": "rhythm",
    "commanded iterations": "rhythm",
}

OPEN, CLOSE = "⟦", "⟧"
"""Stand around the index of a number in the text of a formula whose numbers are open."""


@dataclass(frozen=True)
class Term:
    """A term of a formula: a sign, numbers, and quantities that they multiply.

    Attributes:
        group: What it is there for: that of its last factor, which those before it turn up or down.
        factors: Its factors but for numbers, as the file writes them.
        symbols: What these factors are of: indices of the vocabulary's variables.
        sign: 1 or -1.
        numbers: Indices of the numbers whose product, with that sign, is its coefficient.
        own: The number of these that is in no other term, by which the coefficient is changed; none
            where there is no such number.
    """

    group: str
    factors: tuple[str, ...]
    symbols: tuple[int, ...]
    sign: float
    numbers: tuple[int, ...]
    own: int | None

    def coefficient(self, numbers: Sequence[float]) -> float:
        """Returns what multiplies its factors."""
        return self.sign * math.prod(numbers[index] for index in self.numbers)

    def number_for(self, coefficient: float, numbers: Sequence[float]) -> float | None:
        """Returns what its own number has to be for a coefficient; None where none would do."""
        others = math.prod(numbers[index] for index in self.numbers if index != self.own)
        return None if self.own is None or others == 0.0 else coefficient / (self.sign * others)


@dataclass(frozen=True)
class Acting:
    """Where a formula acts.

    Attributes:
        joint: Index of the joint whose target it is.
        mirrored: Whether it acts as its own mirror image, of what is observed in the mirror.
    """

    joint: int
    mirrored: bool


class TermReader:
    """Splits one formula of a file into terms, and evaluates them where a robot is.

    Attributes:
        place: Where the formula stands in the file.
        terms: Its terms.
        symbols: Indices of all variables that its terms are of.
    """

    def __init__(self, policy: AdjustablePolicy, place: Place) -> None:
        """
        Args:
            policy: The policy that acts.
            place: Where the formula stands, one of those that the file holds.
        """
        self.place, self._policy = place, policy
        numbered = policy.numbered
        parts = numbered.open.formulas[place].terms()
        self.terms = _terms(parts, numbered)
        self.symbols = tuple(sorted({index for term in self.terms for index in term.symbols}))
        shown = [*parts, *(variable(index) for index in self.symbols)]
        self._tape = numbered.tape(shown)
        images = numbered.file.mirror
        names = policy.observation_names
        self._reflection = None if images is None else reflect_observation(names, images)

    def acting(self, state: int) -> tuple[Acting, ...]:
        """Returns where the formula acts in a state of the machine: itself first, then its image.

        A formula of a state that is its own mirror image acts on both sides at once.
        """
        file, joint = self._policy.numbered.file, self.place[-1]
        found: list[Acting] = []
        if len(self.place) == 1 or self.place[0] == state:
            found.append(Acting(joint, mirrored=False))
        if file.mirror is not None:
            image = FormulaMirror(file.mirror, ()).place(self.place)
            held = image in self._policy.numbered.formulas
            if not held and (len(image) == 1 or image[0] == state):
                found.append(Acting(image[-1], mirrored=True))
        return tuple(found)

    def evaluate(self, observation: Array, *, mirrored: bool) -> tuple[Array, Array]:
        """Evaluates terms and symbols where a robot observes (n).

        Args:
            observation: What it observes.
            mirrored: Whether the formula acts as its mirror image; then the values are those of
                the file's own formula in the mirror, whose target has the sign of the joint there.

        Returns:
            What each term adds (k; rad), and the values of `symbols`.
        """
        if mirrored and self._reflection is not None:
            observation = observation[self._reflection.index] * self._reflection.sign
        found = self._tape(self._policy.read(observation))
        return found[: len(self.terms)], found[len(self.terms) :]

    def sign(self, *, mirrored: bool) -> float:
        """Returns the sign between the terms' sum and the target of the joint that it acts on."""
        return float(REFLECT_JOINTS.sign[self.place[-1]]) if mirrored else 1.0


def open_texts(numbered: FileNumbers) -> tuple[tuple[str, str, str], ...]:
    """Returns the definitions that a file holds: symbol, formula with open numbers, and note.

    Number i stands there as ⟦i⟧.
    """
    symbols = _symbols(numbered)
    kept = {own.symbol for own in numbered.definitions}
    return tuple(
        (own.symbol, write_formula(own.formula, symbols), own.note)
        for own in numbered.open.vocabulary.definitions
        if own.symbol in kept
    )


def joint_title(joint: int) -> str:
    """Returns what pages call a joint."""
    return quadruped.JOINTS[joint].replace("_", " ")


def _symbols(numbered: FileNumbers) -> tuple[str, ...]:
    opened = (f"{OPEN}{index}{CLOSE}" for index in range(len(numbered.start)))
    return (*numbered.file.vocabulary.symbols, *opened)


def _terms(parts: Sequence[Expression], numbered: FileNumbers) -> tuple[Term, ...]:
    split = [_split(part, numbered) for part in parts]
    uses = Counter(index for term in split for index in term.numbers)
    return tuple(replace(term, own=_own(term, uses)) for term in split)


def _own(term: Term, uses: Mapping[int, int]) -> int | None:
    alone = [index for index in term.numbers if uses[index] == 1]
    return alone[-1] if alone else None


def _split(part: Expression, numbered: FileNumbers) -> Term:
    first = numbered.n_symbols
    # Numbers inside of a factor, such as of a sine, stay as they are.
    symbols = (*numbered.file.vocabulary.symbols, *map(written_number, numbered.start))
    sign, numbers, factors = 1.0, [], []
    for factor in factors_of(part):
        if factor.operator == "constant":
            sign *= factor.value
        elif factor.operator == "variable" and factor.variable >= first:
            numbers.append(factor.variable - first)
        else:
            factors.append(factor)
    own = sorted(set[int]().union(*(factor.variables for factor in factors)))
    return Term(
        group=_group(factors[-1], numbered) if factors else "constant",
        factors=tuple(write_formula(factor, symbols) for factor in factors),
        symbols=tuple(index for index in own if index < first),
        sign=sign,
        numbers=tuple(numbers),
        own=None,
    )


def _group(factor: Expression, numbered: FileNumbers) -> str:
    """Returns what a factor is of; of several quantities that which pages show first."""
    vocabulary = numbered.file.vocabulary
    held = vocabulary.expanded(factor)
    entries = entries_of(vocabulary.names)
    groups = {_OF_ENTRIES[entries[index].group] for index in held.variables if index < len(entries)}
    return min(groups, key=GROUPS.index, default="constant")


def in_groups(terms: Sequence[Term]) -> list[tuple[str, list[int]]]:
    """Returns the indices of terms by group, in the order in which pages show them."""
    found = [
        (group, [i for i, term in enumerate(terms) if term.group == group]) for group in GROUPS
    ]
    return [(group, indices) for group, indices in found if indices]


def sum_of(values: Array) -> float:
    """Returns the sum of terms, from left to right as a policy adds them up."""
    return float(np.add.accumulate(values)[-1])
