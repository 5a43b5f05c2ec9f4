"""Claims: what the largest terms of a page say, with sign and size, and in words."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glassgait.models.errors import InputError
from glassgait.models.formulas.file import FormulaFile
from glassgait.models.formulas.quantities import Vocabulary
from glassgait.models.robots import quadruped
from glassgait.models.task.observation import entries_of, indices_of
from glassgait.studies.explanation.interventions.terms import Term, readable_terms
from glassgait.studies.explanation.interventions.walks import Walk


@dataclass(frozen=True)
class Claim:
    """What a term says: a greater input moves the joint's target, while the gates are as given.

    Attributes:
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
        walk: What the robots of its policy saw.

    Raises:
        InputError: if fewer terms can be read, or ever count.
    """
    ranked = _ranked(file, walk)
    refuse_too_few(len(ranked), count)
    taken: list[Claim] = []
    for claim in ranked:
        if not any(_alike(claim, other) for other in taken):
            taken.append(claim)
    rest = [claim for claim in ranked if claim not in taken]
    return sorted([*taken, *rest][:count], key=lambda claim: -abs(claim.effect))


def _ranked(file: FormulaFile, walk: Walk) -> list[Claim]:
    """Derives the claims of all terms that can be read, the largest first."""
    found = [claim_of(term, file, walk) for term in readable_terms(file)]
    there = (claim for claim in found if claim is not None)
    return sorted(there, key=lambda claim: -abs(claim.effect))


def refuse_too_few(found: int, count: int) -> None:
    """Refuses to derive more claims than there are terms to derive them from.

    Raises:
        InputError: if there are fewer terms.
    """
    if found < count:
        raise InputError(
            f"--n-claims: {count} claims are asked for, and {found} terms can be read as a "
            "weight times a command, gravity, a speed, a foot's place or a definition; ask for "
            "fewer, or name another policy"
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


LEGS = {"FL": "front left", "FR": "front right", "RL": "rear left", "RR": "rear right"}

LEFT_LEGS = ("FL", "RL")

INPUTS = {
    "cmd.v": "{step} m/s more commanded speed",
    "cmd.yaw": "{step} rad/s more commanded yaw rate to the left",
    "cmd.t": "{step} control steps more of commanded time in a state",
    "g.x": "{step} more of gravity ahead, as with a lower nose,",
    "g.y": "{step} more of gravity to the left, as with a lower left side,",
    "g.z": "{step} more of gravity upward, as with more lean,",
    "w.x": "{step} rad/s more roll to the right",
    "w.y": "{step} rad/s more pitch, nose down,",
    "w.z": "{step} rad/s more turning to the left",
    "v.x": "{step} m/s more forward speed",
    "v.y": "{step} m/s more speed to the left",
    "v.z": "{step} m/s more upward speed",
    "e.v": "{step} m/s more lag behind the commanded speed",
    "h": "{step} m more height of the {leg} foot",
    "x": "the {leg} foot {step} m further before its hip",
    "z": "the {leg} foot {step} m higher to its hip",
    "sent": "{step} more of the gate of the {joint}'s last target",
}
"""What is said of an input, by its name, or by that of its kind where each leg or joint has one."""

FOLLOWED = {"going_speed_error": "speed", "yaw_rate_error": "yaw rate"}


def joint_words(claim: Claim, vocabulary: Vocabulary) -> str:
    """Describes a claim of a joint: what is greater, what then moves which way, and when."""
    return (
        f"{_cause(claim, vocabulary)} {_movement(claim.term.joint_name, claim.effect)}"
        f"{_when(claim, vocabulary)}"
    )


def following_words(claim: Claim, score: str) -> str:
    """Describes the claim that a command's term is there for the command."""
    joint = _joint(claim.term.joint_name)
    missed = FOLLOWED[score]
    return f"Without this term of the {joint}, robots miss their commanded {missed} by more"


def unit_of(symbol: str) -> str:
    """Returns the unit of what robots miss by, where they follow an input."""
    return "rad/s" if symbol == "cmd.yaw" else "m/s"


def _cause(claim: Claim, vocabulary: Vocabulary) -> str:
    symbol, step = vocabulary.symbols[claim.term.input], f"{claim.step:g}"
    kind, _, leg = symbol.partition(".")
    if symbol in INPUTS:
        said = INPUTS[symbol].format(step=step)
    elif kind in INPUTS and leg in LEGS:
        said = INPUTS[kind].format(step=step, leg=LEGS[leg])
    elif kind in INPUTS and leg in quadruped.JOINTS:
        said = INPUTS[kind].format(step=step, joint=_joint(leg))
    else:
        # A definition of a person's own, whose note says what it is.
        said = f"{step} more of {symbol}"
    return said[0].upper() + said[1:]


def _movement(name: str, effect: float) -> str:
    leg, joint = name.split("_")
    forth = effect > 0.0
    match joint:
        case "hip":
            # Positive is to the left on both sides.
            outward = forth == (leg in LEFT_LEGS)
            return f"turns the {_joint(name)} {'outward' if outward else 'inward'}"
        case "thigh":
            return f"swings the {_joint(name)} {'back' if forth else 'forward'}"
        case _:
            return f"{'stretches' if forth else 'bends'} the {_joint(name)}"


def _joint(name: str) -> str:
    leg, joint = name.split("_")
    return f"{LEGS[leg]} {'knee' if joint == 'calf' else joint}"


def _when(claim: Claim, vocabulary: Vocabulary) -> str:
    n_observed = len(entries_of(vocabulary.names))
    state, part, feet = claim.term.state, "", []
    for gate, side in zip(claim.term.gates, claim.sides, strict=True):
        symbol = vocabulary.symbols[gate]
        if gate < n_observed:
            state = int(symbol.removeprefix("s"))
        elif symbol == "late":
            part = "late " if side > 0 else "early "
        else:
            leg = LEGS[symbol.partition(".")[2]]
            feet.append(f"while the {leg} foot is {'in the air' if side > 0 else 'down'}")
    if part or state is not None:
        feet.append(f"{part}in {'a state' if state is None else f'state {state}'}")
    return "".join(f", {foot}" for foot in feet)
