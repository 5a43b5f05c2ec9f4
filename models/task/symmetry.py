"""Left-right symmetry of gaits, observations and actions.

The mirror is the plane of the robot's forward and upward axes: FL and FR change places, and so do
RL and RR.
"""

from collections.abc import Sequence

import numpy as np

from glassgait.models.errors import InputError
from glassgait.models.task.gait import STANCES, Gait, Transition, stance_code
from glassgait.models.task.observation import MIRRORED_LEG_ORDER

_MIRRORED_STANCES = stance_code(STANCES[:, MIRRORED_LEG_ORDER])  # codes of mirror images (16)


def mirrored_states(gait: Gait) -> tuple[int, ...] | None:
    """Returns the index of each RM state's mirror image, or None if the machine favours a side.

    States are renamed so that every transition has a mirror image among the transitions: left and
    right feet exchanged in its formula, and the same dwell and grace.
    """
    outgoing = {
        state: [edge for edge in gait.transitions if edge.source == state] for state in gait.states
    }
    for image in gait.states:
        images = _follow(gait, outgoing, image)
        if images is not None:
            return tuple(gait.states.index(images[state]) for state in gait.states)
    return None


def refuse_other_mirror(states: Sequence[int] | None, gait: Gait) -> None:
    """Refuses a file's mirrored states that differ from those of the gait's machine."""
    if states is None or len(states) != gait.n_states:
        return
    images = mirrored_states(gait)
    if images is None:
        raise InputError(
            f"mirror: is {[*states]}, but the machine of this {gait.name} favours a side and has "
            "no mirror image; remove 'mirror', and write every formula"
        )
    if tuple(states) != images:
        raise InputError(
            f"mirror: is {[*states]}, but the mirror images of the states of this {gait.name} are "
            f"{[*images]}; write 'mirror: {[*images]}'"
        )


def _follow(gait: Gait, outgoing: dict[str, list[Transition]], image: str) -> dict[str, str] | None:
    """Maps states to their mirror images, given that of the initial state; None if impossible.

    A machine is deterministic and reaches all its states, so one pair determines all others.
    """
    images, frontier = {gait.initial: image}, [gait.initial]
    # The list grows during the loop.
    for state in frontier:
        targets = {_signature(edge): edge.target for edge in outgoing[images[state]]}
        for edge in outgoing[state]:
            target = targets.pop(_signature(edge, mirrored=True), None)
            if target is None or images.get(edge.target, target) != target:
                return None
            if edge.target not in images:
                images[edge.target] = target
                frontier.append(edge.target)
        if targets:
            return None
    # The image of a fault is a fault, and the image of an image is the state itself.
    faults_agree = all((a in gait.faults) == (b in gait.faults) for a, b in images.items())
    is_involution = all(images.get(b) == a for a, b in images.items())
    return images if faults_agree and is_involution else None


def _signature(edge: Transition, *, mirrored: bool = False) -> tuple:
    table = np.array(edge.when.table)
    return tuple(table[_MIRRORED_STANCES] if mirrored else table), edge.dwell, edge.grace
