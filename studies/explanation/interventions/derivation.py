"""Claims: what the largest terms of a page say, with sign and size."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glassgait.models.errors import InputError
from glassgait.models.formulas.file import FormulaFile
from glassgait.models.task.observation import indices_of
from glassgait.studies.explanation.interventions.terms import Term, readable_terms
from glassgait.studies.explanation.interventions.walks import Walk


@dataclass(frozen=True)
class Claim:
    """What a term says: a greater input moves the joint's target, while the gates are as given.

    Attributes:
        term: The term.
        sides: Side of each gate that the claim speaks of, where the robot is more often: 1 or -1.
        step: One standard deviation of the input there, in its unit, to two digits.
        effect: How far the target moves for that step, mean over the instants that the claim
            speaks of (rad); the term's size, with its sign.
        mean: Mean of the term wherever its formula acts (rad).
    """

    term: Term
    sides: tuple[int, ...]
    step: float
    effect: float
    mean: float


def derive_claims(file: FormulaFile, walk: Walk, count: int) -> list[Claim]:
    """Derives the claims of the terms that move a target most, of inputs and joints of all sorts.

    A term's size is its weight times one standard deviation of its input, times its gates' mean,
    where the file's own robots go. Largest first, a claim is taken if neither its input nor its
    joint has one yet; if there are too few, then whatever is largest of the others.

    Args:
        file: The file.
        walk: What the robots of its policy saw.
        count: Number of claims.

    Raises:
        InputError: if fewer terms can be read, or ever count.
    """
    found = [claim_of(term, file, walk) for term in readable_terms(file)]
    ranked = sorted(
        (claim for claim in found if claim is not None), key=lambda claim: -abs(claim.effect)
    )
    refuse_too_few(len(ranked), count)
    taken: list[Claim] = []
    for claim in ranked:
        if not any(_alike(claim, other) for other in taken):
            taken.append(claim)
    rest = [claim for claim in ranked if claim not in taken]
    return sorted([*taken, *rest][:count], key=lambda claim: -abs(claim.effect))


def refuse_too_few(found: int, count: int) -> None:
    """Refuses to derive more claims than there are terms to derive them from.

    Raises:
        InputError: if there are fewer terms.
    """
    if found < count:
        raise InputError(
            f"--n-claims: {count} claims are asked for, and {found} terms can be read as a weight "
            "times a command, a speed, a foot's place or a definition; ask for fewer, or name "
            "another policy"
        )


def claim_of(term: Term, file: FormulaFile, walk: Walk) -> Claim | None:
    """Derives the claim of one term; none if it never counts, or its input never changes."""
    acting = acting_mask(term, walk)
    if not acting.any():
        return None
    switches = indices_of("machine state", file.vocabulary.names)
    sides, mask = [], acting
    for gate in term.gates:
        value = walk.quantities[..., gate]
        # A state of the machine is 1 or 0, and says something where it is 1 alone.
        more = np.mean(value[mask] > 0.0) >= 0.5 if gate not in switches else True
        sides.append(1 if more else -1)
        mask = mask & _on_side(value, sides[-1])
        if not mask.any():
            return None
    own = walk.quantities[..., term.input]
    gates = np.prod(walk.quantities[..., list(term.gates)], axis=-1)
    step = float(f"{np.std(own[mask]):.2g}")
    effect = float(term.weight * step * gates[mask].mean())
    if not np.isfinite(effect) or effect == 0.0:
        return None
    mean = float((term.weight * gates * own)[acting].mean())
    return Claim(term, tuple(sides), step, effect, mean)


def acting_mask(term: Term, walk: Walk) -> NDArray[np.bool_]:
    """Returns where a term's formula acts (T, n), and in the mirror, if its image acts there."""
    mask = walk.alive.copy()
    if not term.mirrored:
        mask &= ~walk.image[:, None]
    if term.state is not None:
        mask &= walk.state == term.state
    return mask


def spoken_of(claim: Claim, walk: Walk) -> NDArray[np.bool_]:
    """Returns where robots are when a claim speaks of them (T, n)."""
    mask = acting_mask(claim.term, walk)
    for gate, side in zip(claim.term.gates, claim.sides, strict=True):
        mask &= _on_side(walk.quantities[..., gate], side)
    return mask


def _on_side(gate: NDArray[np.float64], side: int) -> NDArray[np.bool_]:
    return side * gate > 0.0


def _alike(claim: Claim, other: Claim) -> bool:
    return claim.term.input == other.term.input or claim.term.joint == other.term.joint
