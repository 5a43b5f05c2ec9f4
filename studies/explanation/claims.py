"""Claims of formulas: a greater input moves a joint's target by a weight, while gates are open."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.formulas.expression import Expression, canonical, constant, times, variable
from glassgait.models.formulas.file import FormulaFile
from glassgait.models.formulas.grammar import write_formula
from glassgait.models.formulas.mirror import Place
from glassgait.models.formulas.quantities import GATES
from glassgait.models.robots import quadruped
from glassgait.models.task.observation import Group, entries_of

INPUTS: tuple[Group, ...] = (
    "commanded velocity",
    "commanded iterations",
    "gravity",
    "angular velocity",
    "base velocity",
    "foot height",
)
"""Groups of observations that are inputs; those of joints say how a servo continues its motion."""

CLOCKS: tuple[Group, ...] = ("iterations", "machine state")
"""Groups that say when. A definition that uses one of these is no input."""


@dataclass(frozen=True)
class Term:
    """A weight times one input and perhaps gates, which are variables by index."""

    place: Place
    weight: float
    input: int
    gates: tuple[int, ...] = ()

    @property
    def joint(self) -> str:
        return quadruped.JOINTS[self.place[-1]]

    @property
    def state(self) -> int | None:
        """State of the machine in which its formula acts; None if it acts in all."""
        return self.place[0] if len(self.place) > 1 else None

    def with_gates(self, weight: float) -> Expression:
        product = constant(weight)
        for gate in self.gates:
            product = times(product, variable(gate))
        return product

    def text(self, symbols: Sequence[str]) -> str:
        """Writes the term with the given names of variables, such as 0.43*v.z."""
        whole = times(self.with_gates(self.weight), variable(self.input))
        return write_formula(canonical(whole), symbols)


@dataclass(frozen=True)
class Walk:
    """Observations of n robots at T control steps.

    Attributes:
        quantities: Variables of the formulas (T, n, k).
        angle: Joint angles after the step, as sensors measure them (T, n, 12; rad).
        alive: Whether the robot was up to the step's end (T, n).
    """

    quantities: Array
    state: NDArray[np.int64]
    angle: Array
    alive: NDArray[np.bool_]


@dataclass(frozen=True)
class Claim:
    """What a term predicts of the instants when its formula acts and its gates are on their sides.

    Attributes:
        sides: Side of each gate where the robot is more often: 1 or -1.
        step: One standard deviation of the input there, in its unit, to two digits.
        effect: Mean movement of the target for that step (rad).
    """

    term: Term
    sides: tuple[int, ...]
    step: float
    effect: float

    def instants(self, walk: Walk) -> NDArray[np.bool_]:
        """Returns the instants of a walk that the claim is about (T, n)."""
        mask = _acting(self.term, walk)
        for gate, side in zip(self.term.gates, self.sides, strict=True):
            mask = mask & (side * walk.quantities[..., gate] > 0.0)
        return mask


def readable_terms(file: FormulaFile) -> list[Term]:
    """Lists the readable terms of a file's formulas: numbers times one input and perhaps gates.

    Sums are multiplied out, and terms of the same input and gates in one formula are joined.
    """
    entries, symbols = entries_of(file.vocabulary.names), file.vocabulary.symbols
    gates = {i for i, entry in enumerate(entries) if entry.group == "machine state"}
    gates |= {symbols.index(gate) for gate in GATES if gate in symbols}

    # A definition is an input unless it says when.
    inputs = {i for i, entry in enumerate(entries) if entry.group in INPUTS}
    clocks = {i for i, entry in enumerate(entries) if entry.group in CLOCKS}
    for i, definition in enumerate(file.vocabulary.definitions, start=len(entries)):
        if definition.symbol not in GATES and not definition.formula.variables & clocks:
            inputs.add(i)
    return [
        term
        for place, formula in sorted(file.written().items())
        for term in _terms_of(place, formula, inputs, gates)
    ]


def derive_claims(file: FormulaFile, walk: Walk, count: int) -> list[Claim]:
    """Derives the claims of the terms that move a target most on a walk.

    Claims of an input and a joint that no larger claim has are taken first.
    """
    found = [claim_of(term, walk) for term in readable_terms(file)]
    ranked = sorted((own for own in found if own), key=lambda claim: -abs(claim.effect))
    refuse_too_few(len(ranked), count)
    taken: list[Claim] = []
    for claim in ranked:
        term, others = claim.term, [other.term for other in taken]
        if not any(term.input == own.input or term.joint == own.joint for own in others):
            taken.append(claim)
    # Fill up with the others, the largest first.
    rest = [claim for claim in ranked if claim not in taken]
    return sorted([*taken, *rest][:count], key=lambda claim: -abs(claim.effect))


def refuse_too_few(found: int, count: int) -> None:
    if found < count:
        raise InputError(
            f"--n-claims: {count} claims are asked for, and {found} terms can be read as a weight "
            "times a command, gravity, a speed, a foot's place or a definition; ask for fewer, or "
            "name another policy"
        )


def claim_of(term: Term, walk: Walk) -> Claim | None:
    """Derives the claim of one term; None if it never counts, or its input never changes."""
    # A state of the machine is 1 or 0; other gates lie between -1 and 1.
    sides, acting = [], _acting(term, walk)
    for gate in term.gates:
        value = walk.quantities[..., gate]
        sides.append(-1 if np.count_nonzero(value[acting] < 0.0) > acting.sum() / 2 else 1)
        acting = acting & (sides[-1] * value > 0.0)
    if not acting.any():
        return None
    gates = np.prod(walk.quantities[..., list(term.gates)], axis=-1)
    step = float(f"{np.std(walk.quantities[..., term.input][acting]):.2g}")
    effect = float(term.weight * step * gates[acting].mean())
    if not np.isfinite(effect) or effect == 0.0:
        return None
    return Claim(term, tuple(sides), step, effect)


def _acting(term: Term, walk: Walk) -> NDArray[np.bool_]:
    """Returns where a term's formula acts (T, n)."""
    return walk.alive if term.state is None else walk.alive & (walk.state == term.state)


def _terms_of(
    place: Place, formula: Expression, inputs: set[int], gates: set[int]
) -> Iterator[Term]:
    weights: dict[tuple[int, tuple[int, ...]], float] = {}
    for whole in formula.terms():
        weight, factors = _product(whole) or (0.0, [])
        named = [factor for factor in factors if factor in inputs]
        when = sorted(factor for factor in factors if factor in gates)
        # A gate that counts twice, such as late*late, has no sign any more.
        if len(named) == 1 and len(named) + len(set(when)) == len(factors):
            key = (named[0], tuple(when))
            weights[key] = weights.get(key, 0.0) + weight
    for (index, when), weight in weights.items():
        yield Term(place, weight, index, when)


def _product(formula: Expression) -> tuple[float, list[int]] | None:
    """Reads a formula as a number times variables; None if it is anything else."""
    match formula.operator:
        case "constant":
            return formula.value, []
        case "variable":
            return 1.0, [formula.variable]
        case "neg" | "mul":
            weight, factors = -1.0 if formula.operator == "neg" else 1.0, list[int]()
            for read in map(_product, formula.operands):
                if read is None:
                    return None
                weight, factors = weight * read[0], factors + read[1]
            return weight, factors
    return None
