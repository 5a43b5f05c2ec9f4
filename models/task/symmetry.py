"""Left-right symmetry of gaits, observations and actions.

The mirror is the plane of the robot's forward and upward axes: FL and FR change places, and so do
RL and RR.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.robots import quadruped
from glassgait.models.task.gait import STANCES, Gait, Transition, stance_code
from glassgait.models.task.observation import ObservationEntry, entries_of

MIRRORED_LEGS = {"FL": "FR", "FR": "FL", "RL": "RR", "RR": "RL"}

_LEG_ORDER = np.array([quadruped.LEGS.index(MIRRORED_LEGS[leg]) for leg in quadruped.LEGS])
_MIRRORED_STANCES = stance_code(STANCES[:, _LEG_ORDER])
"""Code of each stance's mirror image (16)."""


@dataclass(frozen=True)
class Reflection:
    """The mirror image of a vector: its entries in another order (n), with signs (n).

    Attributes:
        index: Index of the entry that each entry of the image is taken from.
        sign: Factor on it, 1 or -1.
    """

    index: NDArray[np.int64]
    sign: Array

    def __call__(self, values: Array) -> Array:
        """Maps vectors (..., n) to their mirror images (..., n)."""
        return values[..., self.index] * self.sign

    def split(self, count: int) -> tuple["Reflection", "Reflection"]:
        """Returns the reflections of the first `count` entries and of the others."""
        first = Reflection(self.index[:count], self.sign[:count])
        return first, Reflection(self.index[count:] - count, self.sign[count:])


def mirrored_states(gait: Gait) -> tuple[int, ...] | None:
    """Finds the mirror image of each state of a gait's reward machine.

    The machine is symmetric if its states can be renamed so that every transition has a mirror
    image among the transitions: left and right feet exchanged in its formula, and the same dwell
    and grace.

    Returns:
        Indices of the images (n_states), or None if the machine favours a side.
    """
    outgoing = {
        state: [edge for edge in gait.transitions if edge.source == state] for state in gait.states
    }
    for image in gait.states:
        found = _follow(gait, outgoing, image)
        if found is not None:
            return tuple(gait.states.index(found[state]) for state in gait.states)
    return None


def refuse_other_mirror(states: Sequence[int] | None, gait: Gait) -> None:
    """Refuses mirrored states, as a file states them, that are not those of the gait's machine.

    Raises:
        InputError: if the machine favours a side, or has other states in the mirror.
    """
    if states is None or len(states) != gait.n_states:
        return
    images, said = mirrored_states(gait), [*states]
    if images is None:
        raise InputError(
            f"mirror: is {said}, and the machine of this {gait.name} favours a side, so that it "
            "has no mirror image; leave 'mirror' out, and give every formula"
        )
    if tuple(states) != images:
        raise InputError(
            f"mirror: is {said}, and by the machine of this {gait.name} its states in the mirror "
            f"are {[*images]}; write 'mirror: {[*images]}'"
        )


def _follow(gait: Gait, outgoing: dict[str, list[Transition]], image: str) -> dict[str, str] | None:
    """Follows all transitions from the initial state and from its image at once.

    A machine is deterministic and reaches all its states, so one pair decides all others.
    """
    images = {gait.initial: image}
    frontier = deque(images)
    while frontier:
        state = frontier.popleft()
        theirs = {_signature(edge): edge.target for edge in outgoing[images[state]]}
        for edge in outgoing[state]:
            target = theirs.pop(_signature(edge, mirrored=True), None)
            if target is None or images.get(edge.target, target) != target:
                return None
            if edge.target not in images:
                images[edge.target] = target
                frontier.append(edge.target)
        if theirs:
            return None
    faults_agree = all((a in gait.faults) == (b in gait.faults) for a, b in images.items())
    twice_is_none = all(images.get(b) == a for a, b in images.items())
    return images if faults_agree and twice_is_none else None


def _signature(edge: Transition, *, mirrored: bool = False) -> tuple:
    table = np.array(edge.when.table)
    return tuple(table[_MIRRORED_STANCES] if mirrored else table), edge.dwell, edge.grace


def reflect_observation(names: Sequence[str], states: Sequence[int]) -> Reflection:
    """Returns the reflection of observations, by their names and the gait's `mirrored_states`."""
    entries = entries_of(names)
    places = {entry.name: i for i, entry in enumerate(entries)}
    index = [places[_image_name(entry, states)] for entry in entries]
    return Reflection(np.array(index), np.array([entry.mirror_sign for entry in entries]))


def _image_name(entry: ObservationEntry, states: Sequence[int]) -> str:
    if entry.group == "machine state":
        number = int(entry.name.removeprefix(f"{entry.merged_name} "))
        return f"{entry.merged_name} {states[number]}"
    if entry.leg is None:
        return entry.name
    return entry.name.replace(entry.leg, MIRRORED_LEGS[entry.leg])


def _reflect_joints() -> Reflection:
    joints = np.arange(quadruped.N_JOINTS).reshape(quadruped.N_LEGS, -1)[_LEG_ORDER].ravel()
    sign = [-1.0 if joint == "hip" else 1.0 for joint in quadruped.LEG_JOINTS]
    return Reflection(joints, np.tile(sign, quadruped.N_LEGS))


REFLECT_JOINTS = _reflect_joints()
"""The reflection of joint positions, velocities and actions (12): hips turn the other way."""
