"""Claims in words."""

from glassgait.models.formulas.quantities import Vocabulary
from glassgait.models.task.observation import entries_of
from glassgait.studies.explanation.interventions.derivation import Claim

LEGS = {"FL": "front left", "FR": "front right", "RL": "rear left", "RR": "rear right"}

LEFT_LEGS = ("FL", "RL")

INPUTS = {
    "cmd.v": "{step} m/s more commanded speed",
    "cmd.yaw": "{step} rad/s more commanded yaw rate to the left",
    "cmd.t": "{step} control steps more of commanded time in a state",
    "v.x": "{step} m/s more forward speed",
    "v.y": "{step} m/s more speed to the left",
    "v.z": "{step} m/s more upward speed",
    "e.v": "{step} m/s more lag behind the commanded speed",
    "h": "{step} m more height of the {leg} foot",
    "x": "the {leg} foot {step} m further before its hip",
    "z": "the {leg} foot {step} m higher to its hip",
}
"""What is said of an input, by its name, or by that of its kind where each leg has one."""

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
