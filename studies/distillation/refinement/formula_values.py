"""Formulas whose numbers are torch's: their targets, and how each number moves them."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol, Self

import numpy as np
import torch

from glassgait.models.formulas.expression import Expression
from glassgait.models.formulas.mirror import FormulaMirror, Place
from glassgait.models.formulas.numbers import WeightedSum, numbers_of
from glassgait.models.formulas.quantities import Vocabulary
from glassgait.models.formulas.tape import Tape
from glassgait.models.robots import quadruped
from glassgait.models.task.symmetry import REFLECT_JOINTS

_TORCH: dict[str, Callable[..., torch.Tensor]] = {
    "add": torch.add,
    "sub": torch.sub,
    "mul": torch.mul,
    "div": torch.div,
    "neg": torch.neg,
    "sin": torch.sin,
    "cos": torch.cos,
    "tanh": torch.tanh,
    "exp": torch.exp,
    "log": torch.log,
    "sqrt": torch.sqrt,
    "abs": torch.abs,
    "square": torch.square,
    "cube": lambda x: x * x * x,
}


@dataclass(frozen=True)
class Sensed:
    """What formulas read of n robots.

    Attributes:
        own: Quantities (n, k).
        image: The same in the mirror (n, k), where formulas have one.
        state: The RM state (n), all 0 where formulas act in every state.
    """

    own: torch.Tensor
    image: torch.Tensor | None
    state: torch.Tensor

    def rows(self, n_states: int) -> list[torch.Tensor]:
        """Returns which robots are in each state."""
        return [torch.nonzero(self.state == index).flatten() for index in range(n_states)]

    def at(self, rows: torch.Tensor) -> "Sensed":
        """Returns what formulas read of some robots."""
        image = None if self.image is None else self.image[rows]
        return Sensed(self.own[rows], image, self.state[rows])


@dataclass(frozen=True)
class Joint:
    """Where the formula of a joint in a state comes from.

    Attributes:
        written: Place of the formula that is written.
        sign: What its value is multiplied by.
        mirrored: Whether it reads what is sensed in the mirror.
    """

    written: Place
    sign: float = 1.0
    mirrored: bool = False


@dataclass(frozen=True)
class Written:
    """The formulas that a file holds, each with its numbers among all, and the joints they serve.

    Attributes:
        formulas: Formulas by place.
        vocabulary: What their variables are.
        mirror: The mirror of those that are left out.
        n_states: RM states that formulas differ by, or None.
    """

    formulas: Mapping[Place, Expression]
    vocabulary: Vocabulary
    mirror: FormulaMirror | None
    n_states: int | None

    @property
    def spans(self) -> dict[Place, slice]:
        """Where each formula's numbers stand among all."""
        counts = [len([*numbers_of(own)]) for own in self.formulas.values()]
        ends = np.cumsum(counts).tolist()
        return dict(zip(self.formulas, map(slice, [0, *ends], ends), strict=True))

    @property
    def joints(self) -> tuple[tuple[Joint, ...], ...]:
        """Where each joint's formula comes from, by state."""
        states = [()] if self.n_states is None else [(index,) for index in range(self.n_states)]
        return tuple(
            tuple(self._joint((*state, joint)) for joint in range(quadruped.N_JOINTS))
            for state in states
        )

    def _joint(self, place: Place) -> Joint:
        if place in self.formulas:
            return Joint(place)
        assert self.mirror is not None
        return Joint(self.mirror.place(place), float(REFLECT_JOINTS.sign[place[-1]]), mirrored=True)


class FormulaValues(Protocol):
    """Evaluates formulas with any numbers."""

    def targets(self, sensed: Sensed, numbers: torch.Tensor) -> torch.Tensor:
        """Returns targets (n, 12; rad) by the numbers of all formulas (p)."""
        ...

    def slopes(self, sensed: Sensed, numbers: torch.Tensor) -> torch.Tensor:
        """Differentiates targets by numbers (n, 12, p; rad), each by those of its own formula."""
        ...


def values_of(written: Written) -> FormulaValues:
    """Returns what evaluates formulas: by one product where all their numbers are weights."""
    sums = {place: WeightedSum.of(formula) for place, formula in written.formulas.items()}
    weighted = {place: own for place, own in sums.items() if own is not None}
    return WeightedTerms(written, weighted) if len(weighted) == len(sums) else Trees(written)


class WeightedTerms:
    """Formulas whose numbers are weights of terms: what is sensed gives the terms, once.

    A term that stands in several formulas is evaluated once, and no derivative goes through it.
    """

    def __init__(self, written: Written, sums: Mapping[Place, WeightedSum]) -> None:
        """
        Args:
            written: The formulas.
            sums: The same, split into terms.
        """
        vocabulary = written.vocabulary
        terms = [term for own in sums.values() for term in (*own.terms, own.rest)]
        columns = {term: column for column, term in enumerate(dict.fromkeys(terms))}
        self._tape = Tape([vocabulary.expanded(term) for term in columns], len(vocabulary.names))
        self._states = [
            [
                _Weights.of(joints, mirrored, written.spans, sums, columns)
                for mirrored in (False, True)
            ]
            for joints in written.joints
        ]

    def targets(self, sensed: Sensed, numbers: torch.Tensor) -> torch.Tensor:
        """Returns targets (n, 12; rad) by the numbers of all formulas (p)."""
        read, rows = self._terms(sensed), sensed.rows(len(self._states))
        parts = []
        for here, sides in zip(rows, self._states, strict=True):
            matrices = [own.matrix(numbers) for own in sides]
            # Without a mirror image there is nothing that the second side reads.
            products = [terms[here] @ own for terms, own in zip(read, matrices, strict=False)]
            parts.append(torch.stack(products).sum(dim=0))
        # Each row has a state, so that the parts are all rows in another order.
        return torch.cat(parts)[torch.argsort(torch.cat(rows))]

    def slopes(self, sensed: Sensed, numbers: torch.Tensor) -> torch.Tensor:
        """Differentiates targets by numbers (n, 12, p; rad), each by those of its own formula."""
        slopes = torch.zeros((len(sensed.state), quadruped.N_JOINTS, len(numbers)))
        read, rows = self._terms(sensed), sensed.rows(len(self._states))
        for here, sides in zip(rows, self._states, strict=True):
            for terms, own in zip(read, sides, strict=False):
                slopes[here[:, None], own.joints, own.numbers] = (
                    own.signs * terms[here][:, own.terms]
                )
        return slopes

    def _terms(self, sensed: Sensed) -> list[torch.Tensor]:
        """Evaluates all terms (n, m), of what is sensed and of its mirror image."""
        both = [own for own in (sensed.own, sensed.image) if own is not None]
        return [torch.from_numpy(self._tape(own.double().numpy())).float() for own in both]


@dataclass(frozen=True)
class _Weights:
    """Where a state's numbers multiply terms, of formulas that read what is sensed or its image.

    Attributes:
        rest: Terms that no number multiplies, 1 or -1 where one belongs to a joint (m, 12).
        numbers, terms, joints, signs: Which number, times its sign, multiplies which term of which
            joint.
    """

    rest: torch.Tensor
    numbers: torch.Tensor
    terms: torch.Tensor
    joints: torch.Tensor
    signs: torch.Tensor

    @classmethod
    def of(
        cls,
        joints: Sequence[Joint],
        mirrored: bool,
        spans: Mapping[Place, slice],
        sums: Mapping[Place, WeightedSum],
        columns: Mapping[Expression, int],
    ) -> Self:
        """Finds them for the joints of a state.

        Args:
            joints: The joints.
            mirrored: Whether of those whose formulas read the mirror image, or of the others.
            spans: Where each formula's numbers stand among all.
            sums: Formulas, split into terms.
            columns: Where each term stands among all.
        """
        rest = torch.zeros((len(columns), quadruped.N_JOINTS))
        found: list[tuple[int, int, int, float]] = []
        for index, joint in enumerate(joints):
            if joint.mirrored == mirrored:
                own = sums[joint.written]
                rest[columns[own.rest], index] = joint.sign
                first = spans[joint.written].start
                for number, term in enumerate(own.terms, first):
                    found.append((number, columns[term], index, joint.sign))
        index = torch.tensor([own[:3] for own in found], dtype=torch.long).reshape(-1, 3)
        numbers, terms, places = index.unbind(dim=1)
        return cls(rest, numbers, terms, places, torch.tensor([own[3] for own in found]))

    def matrix(self, numbers: torch.Tensor) -> torch.Tensor:
        """Returns what multiplies each term of each joint (m, 12)."""
        own = self.signs * numbers[self.numbers]
        return self.rest.index_put((self.terms, self.joints), own, accumulate=True)


class Trees:
    """Formulas of any kind, walked through in torch."""

    def __init__(self, written: Written) -> None:
        """
        Args:
            written: The formulas.
        """
        self._written = written
        self._spans, self._states = written.spans, written.joints

    def targets(self, sensed: Sensed, numbers: torch.Tensor) -> torch.Tensor:
        """Returns targets (n, 12; rad) by the numbers of all formulas (p)."""
        rows = sensed.rows(len(self._states))
        parts = [
            torch.stack(
                [value(numbers[own]) for own, value in self._values(state, sensed.at(here))], dim=1
            )
            for state, here in enumerate(rows)
        ]
        return torch.cat(parts)[torch.argsort(torch.cat(rows))]

    def slopes(self, sensed: Sensed, numbers: torch.Tensor) -> torch.Tensor:
        """Differentiates targets by numbers (n, 12, p; rad), each by those of its own formula."""
        slopes = torch.zeros((len(sensed.state), quadruped.N_JOINTS, len(numbers)))
        for state, here in enumerate(sensed.rows(len(self._states))):
            for joint, (own, value) in enumerate(self._values(state, sensed.at(here))):
                slopes[here, joint, own] = torch.func.jacfwd(value)(numbers[own])
        return slopes

    def _values(
        self, state: int, sensed: Sensed
    ) -> Iterator[tuple[slice, Callable[[torch.Tensor], torch.Tensor]]]:
        """Yields each joint's formula: where its numbers stand, and what maps them to targets."""
        own = self._variables(sensed.own)
        image = own if sensed.image is None else self._variables(sensed.image)
        for joint in self._states[state]:
            variables = image if joint.mirrored else own
            yield self._spans[joint.written], partial(self._evaluate, joint, variables)

    def _variables(self, quantities: torch.Tensor) -> list[torch.Tensor]:
        observed = list(quantities.unbind(dim=1))
        definitions = (own.formula for own in self._written.vocabulary.definitions)
        return observed + [
            _value(formula, observed, map(torch.tensor, numbers_of(formula)))
            for formula in definitions
        ]

    def _evaluate(
        self, joint: Joint, variables: list[torch.Tensor], numbers: torch.Tensor
    ) -> torch.Tensor:
        formula = self._written.formulas[joint.written]
        value = joint.sign * _value(formula, variables, iter(numbers.unbind()))
        # A formula that is a number is one for every robot.
        return value.expand_as(variables[0])


def _value(
    formula: Expression, variables: list[torch.Tensor], numbers: Iterator[torch.Tensor]
) -> torch.Tensor:
    """Evaluates a formula whose constants are the next of `numbers`."""
    match formula.operator:
        case "constant":
            return next(numbers)
        case "variable":
            return variables[formula.variable]
        case operator:
            operands = [_value(operand, variables, numbers) for operand in formula.operands]
            return _TORCH[operator](*operands)
