"""What formulas are fitted to, by state; a mirror shares them between left and right."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.formulas.mirror import FormulaMirror, Place
from glassgait.models.formulas.quantities import Vocabulary
from glassgait.models.robots import quadruped
from glassgait.models.task.observation import indices_of
from glassgait.models.task.symmetry import REFLECT_JOINTS, reflect_observation
from glassgait.studies.distillation.students.student import TrainingSet


@dataclass(frozen=True)
class FormulaSamples:
    """What formulas that share their samples are fitted to, such as those of one state.

    Attributes:
        places: Where these formulas stand (k).
        observations: Samples (m, n).
        targets: What each formula should be there (m, k; rad).
    """

    places: tuple[Place, ...]
    observations: Array
    targets: Array


def samples_of_joints(samples: TrainingSet) -> FormulaSamples:
    """Returns what formulas are fitted to that serve every state of the machine, one a joint."""
    places = tuple((joint,) for joint in range(quadruped.N_JOINTS))
    targets = samples.robot.joint_targets(samples.actions)
    return FormulaSamples(places, samples.observations, targets)


def written_places(vocabulary: Vocabulary, mirror: Sequence[int] | None) -> tuple[Place, ...]:
    """Lists the formulas of a policy that are no mirror images of ones before them.

    Args:
        vocabulary: What the formulas may hold.
        mirror: State that each state is in the mirror; None for a policy without a mirror image.
    """
    n_states = len(indices_of("machine state", vocabulary.names))
    every = [(state, joint) for state in range(n_states) for joint in range(quadruped.N_JOINTS)]
    if mirror is None:
        return tuple(every)
    image = FormulaMirror.of(vocabulary, mirror)
    return tuple(place for place in every if place < image.place(place))


def samples_by_state(
    samples: TrainingSet, vocabulary: Vocabulary, mirror: Sequence[int] | None
) -> list[FormulaSamples]:
    """Sorts samples by the state whose formulas they serve; mirrored, each counts twice.

    Args:
        samples: What robots observed, and what the expert would do.
        vocabulary: What the formulas may hold.
        mirror: State that each state is in the mirror; None for a policy without a mirror image.
    """
    whole = samples if mirror is None else _with_mirror_images(samples, mirror)
    targets, places = samples.robot.joint_targets(whole.actions), written_places(vocabulary, mirror)
    parts = []
    for state, mine in enumerate(whole.by_state()):
        own = tuple(place for place in places if place[0] == state)
        if own:
            joints = [joint for _, joint in own]
            parts.append(FormulaSamples(own, whole.observations[mine], targets[mine][:, joints]))
    return parts


def _with_mirror_images(samples: TrainingSet, mirror: Sequence[int]) -> TrainingSet:
    reflect = reflect_observation(samples.observation_names, mirror)
    return replace(
        samples,
        observations=np.concatenate([samples.observations, reflect(samples.observations)]),
        actions=np.concatenate([samples.actions, REFLECT_JOINTS(samples.actions)]),
        starts=np.tile(samples.starts, 2),
    )
