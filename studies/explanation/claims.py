"""Claims of formulas: how far a change of an input moves a joint's target while gates are open."""

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
from glassgait.models.formulas.quantities import GATES, PHASES
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
"""Groups of observations that are inputs. Joints are not: their terms continue a motion."""

CLOCKS: tuple[Group, ...] = ("iterations", "machine state")
"""Groups of observations of the gait's progress; definitions that use them are not inputs."""


@dataclass(frozen=True)
class Term:
    """A weight times one input and any gates; input and gates are indices of variables."""

    place: Place
    weight: float
    input: int
    gates: tuple[int, ...] = ()

    @property
    def joint(self) -> str:
        return quadruped.JOINTS[self.place[-1]]

    @property
    def state(self) -> int | None:
        """RM state in which its formula acts; None if it acts in all."""
        return self.place[0] if len(self.place) > 1 else None

    def with_gates(self, weight: float) -> Expression:
        product = constant(weight)
        for gate in self.gates:
            product = times(product, variable(gate))
        return product

    def text(self, symbols: Sequence[str]) -> str:
        """Writes the term with the given names of variables, such as 0.43*v.z."""
        term = times(self.with_gates(self.weight), variable(self.input))
        return write_formula(canonical(term), symbols)


@dataclass(frozen=True)
class Walk:
    """Observations of n robots at T control steps.

    Attributes:
        quantities: Variables of the formulas (T, n, k).
        angle: Joint angles after the step, as sensors measure them (T, n, 12; rad).
        alive: Whether the robot had not fallen by the end of the step (T, n).
    """

    quantities: Array
    state: NDArray[np.int64]
    angle: Array
    alive: NDArray[np.bool_]


@dataclass(frozen=True)
class Claim:
    """A term's prediction for the instants when its formula acts and its gates have given signs.

    Attributes:
        sides: The more frequent sign of each gate: 1 or -1.
        step: One standard deviation of the input at these instants, in its unit, to two digits.
        effect: Mean change of the target by such a step (rad).
    """

    term: Term
    sides: tuple[int, ...]
    step: float
    effect: float

    def instants(self, walk: Walk) -> NDArray[np.bool_]:
        """Returns a mask of the claim's instants in a walk (T, n)."""
        mask = _acting(self.term, walk)
        for gate, side in zip(self.term.gates, self.sides, strict=True):
            mask = mask & (side * walk.quantities[..., gate] > 0.0)
        return mask


def readable_terms(file: FormulaFile) -> list[Term]:
    """Lists the readable terms of a file's formulas: numbers times one input and any gates.

    Products of sums are expanded, and a formula's terms with equal input and gates are added up.
    """
    entries, symbols = entries_of(file.vocabulary.names), file.vocabulary.symbols
    gates = {i for i, entry in enumerate(entries) if entry.group == "machine state"}
    gates |= {symbols.index(gate) for gate in (*GATES, *PHASES) if gate in symbols}

    # A definition is an input unless it depends on the gait's progress.
    inputs = {i for i, entry in enumerate(entries) if entry.group in INPUTS}
    clocks = {i for i, entry in enumerate(entries) if entry.group in CLOCKS}
    for i, definition in enumerate(file.vocabulary.definitions, start=len(entries)):
        if definition.symbol not in (*GATES, *PHASES) and not definition.formula.variables & clocks:
            inputs.add(i)
    return [
        term
        for place, formula in sorted(file.written().items())
        for term in _terms_of(place, formula, inputs, gates)
    ]


def derive_claims(file: FormulaFile, walk: Walk, count: int) -> list[Claim]:
    """Derives the claims of the terms that move a target most in a walk.

    Claims whose input and joint differ from those of all larger claims come first.
    """
    claims = [claim_of(term, walk) for term in readable_terms(file)]
    ranked = sorted(filter(None, claims), key=lambda claim: -abs(claim.effect))
    refuse_too_few(len(ranked), count)
    distinct: list[Claim] = []
    for claim in ranked:
        term, others = claim.term, [other.term for other in distinct]
        if not any(term.input == other.input or term.joint == other.joint for other in others):
            distinct.append(claim)
    # Fill up with the others, the largest first.
    rest = [claim for claim in ranked if claim not in distinct]
    return sorted([*distinct, *rest][:count], key=lambda claim: -abs(claim.effect))


def refuse_too_few(n_terms: int, count: int) -> None:
    if n_terms < count:
        raise InputError(
            f"--n-claims: {count} claims are asked for, but only {n_terms} terms are a weight "
            "times an input and gates; ask for fewer, or name another policy"
        )


def claim_of(term: Term, walk: Walk) -> Claim | None:
    """Derives the claim of one term; None if it never acts, or its input never changes."""
    # RM states are 1 or 0; other gates lie between -1 and 1.
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
    """Returns a mask of the instants when a term's formula acts (T, n)."""
    return walk.alive if term.state is None else walk.alive & (walk.state == term.state)


def _terms_of(
    place: Place, formula: Expression, inputs: set[int], gates: set[int]
) -> Iterator[Term]:
    weights: dict[tuple[int, tuple[int, ...]], float] = {}
    for term in formula.terms():
        weight, factors = _product(term) or (0.0, [])
        term_inputs = [factor for factor in factors if factor in inputs]
        term_gates = tuple(sorted(factor for factor in factors if factor in gates))
        # The square of a gate, such as late*late, has no sign.
        if len(term_inputs) == 1 and 1 + len(set(term_gates)) == len(factors):
            key = (term_inputs[0], term_gates)
            weights[key] = weights.get(key, 0.0) + weight
    for (index, term_gates), weight in weights.items():
        yield Term(place, weight, index, term_gates)


def _product(formula: Expression) -> tuple[float, list[int]] | None:
    """Returns a product's number and variables; None if the formula is not a product."""
    match formula.operator:
        case "constant":
            return formula.value, []
        case "variable":
            return 1.0, [formula.variable]
        case "neg" | "mul":
            weight, factors = -1.0 if formula.operator == "neg" else 1.0, list[int]()
            for operand in map(_product, formula.operands):
                if operand is None:
                    return None
                weight, factors = weight * operand[0], factors + operand[1]
            return weight, factors
    return None
