"""Samples for formulas that a mirror shares between left and right."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from glassgait.models.a1 import robot
from glassgait.models.a1.robot import Array
from glassgait.models.policies.formula_mirror import FormulaMirror, Place
from glassgait.models.policies.quantities import Vocabulary, targets_of
from glassgait.models.task.observation import indices_of
from glassgait.models.task.symmetry import REFLECT_JOINTS, reflect_observation
from glassgait.studies.students.dataset import Dataset


@dataclass(frozen=True)
class StateSamples:
    """What the formulas of one state of the machine are fitted to.

    Attributes:
        places: Where these formulas stand (k).
        observations: Samples (m, n).
        targets: What each formula should be there (m, k; rad).
    """

    places: tuple[Place, ...]
    observations: Array
    targets: Array


def written_places(vocabulary: Vocabulary, mirror: Sequence[int] | None) -> tuple[Place, ...]:
    """Lists the formulas of a policy that are no mirror images of ones before them.

    Args:
        vocabulary: What the formulas may hold.
        mirror: State that each state is in the mirror; None for a policy without a mirror image.
    """
    n_states = len(indices_of("machine state", vocabulary.names))
    every = [(state, joint) for state in range(n_states) for joint in range(robot.N_JOINTS)]
    if mirror is None:
        return tuple(every)
    image = FormulaMirror.of(vocabulary, mirror)
    return tuple(place for place in every if place < image.place(place))


def by_state(
    data: Dataset, vocabulary: Vocabulary, mirror: Sequence[int] | None
) -> list[StateSamples]:
    """Sorts samples by the state whose formulas they serve; mirrored, each counts twice.

    Args:
        data: What robots observed, and what the expert would do.
        vocabulary: What the formulas may hold.
        mirror: State that each state is in the mirror; None for a policy without a mirror image.
    """
    observations, actions = data.observations, data.actions
    if mirror is not None:
        reflect = reflect_observation(vocabulary.names, mirror)
        observations = np.concatenate([observations, reflect(observations)])
        actions = np.concatenate([actions, REFLECT_JOINTS(actions)])
    one_hot = observations[:, list(indices_of("machine state", vocabulary.names))]
    states, targets = one_hot.argmax(axis=1), targets_of(actions)
    places = written_places(vocabulary, mirror)
    parts = []
    for state in sorted({state for state, _ in places}):
        own = tuple(place for place in places if place[0] == state)
        # A state that was never visited is fitted like all together.
        mine = states == state if (states == state).any() else np.ones(len(states), dtype=bool)
        joints = [joint for _, joint in own]
        parts.append(StateSamples(own, observations[mine], targets[mine][:, joints]))
    return parts
