"""A page of formulas: so few terms in all that a person reads them at one sitting.

Each term goes to the formula that it helps most; a mirror shares formulas between left and right.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.formulas.expression import Expression
from glassgait.models.formulas.mirror import FormulaMirror, Place
from glassgait.models.formulas.quantities import Vocabulary
from glassgait.models.formulas.tape import Tape
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.settings import Count
from glassgait.models.task.observation import indices_of
from glassgait.models.task.symmetry import REFLECT_JOINTS, reflect_observation
from glassgait.studies.distillation.students.gated_sum import gated_expression, weight_paths
from glassgait.studies.distillation.students.student import Student, StudentSettings, TrainingSet
from glassgait.studies.distillation.students.symbolic import FormulaFit, gates, readable, settled


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
    every = [(state, joint) for state in range(n_states) for joint in range(quadruped.N_JOINTS)]
    if mirror is None:
        return tuple(every)
    image = FormulaMirror.of(vocabulary, mirror)
    return tuple(place for place in every if place < image.place(place))


def samples_by_state(
    samples: TrainingSet, vocabulary: Vocabulary, mirror: Sequence[int] | None
) -> list[StateSamples]:
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
            parts.append(StateSamples(own, whole.observations[mine], targets[mine][:, joints]))
    return parts


def _with_mirror_images(samples: TrainingSet, mirror: Sequence[int]) -> TrainingSet:
    reflect = reflect_observation(samples.observation_names, mirror)
    return replace(
        samples,
        observations=np.concatenate([samples.observations, reflect(samples.observations)]),
        actions=np.concatenate([samples.actions, REFLECT_JOINTS(samples.actions)]),
        starts=np.tile(samples.starts, 2),
    )


LONGEST = 40
"""Greatest number of terms of one formula, its constant not counted."""

LOOKED_AHEAD = 4
"""Terms that are weighed together: two may help where neither does alone."""


@dataclass(frozen=True)
class _Growth:
    """How a formula grows with its terms.

    Attributes:
        weights: Weights after each number of terms but the constant (terms + 1, g + 1, n).
        intercepts: Constants (terms + 1).
        errors: Mean squared errors (terms + 1; rad²).
    """

    weights: Array
    intercepts: Array
    errors: Array


def possible_terms(n_formulas: int) -> range:
    """Returns the numbers of terms that so many formulas can have in all, a term each at least."""
    return range(n_formulas, n_formulas * (1 + LONGEST) + 1)


def condense(samples: TrainingSet, n_terms: int, *, mirrored: bool) -> FormulaPolicy:
    """Fits the formulas of every joint and state of the machine with so many terms in all.

    A term is a number times quantities; a formula's constant is one. Mirror images cost none.

    Args:
        samples: What robots observed, and what the expert would do.
        n_terms: Number of terms, one for each formula at least.
        mirrored: Whether the formulas of one side are mirror images of the other's, where the
            gait's machine has a mirror image.

    Raises:
        InputError: if there are fewer terms than formulas, or more than formulas may have.
    """
    names, mirror = samples.observation_names, samples.mirror if mirrored else None
    fit = FormulaFit(samples.robot, names, gates)
    parts = samples_by_state(samples, fit.vocabulary, mirror)
    possible = possible_terms(sum(len(part.places) for part in parts))
    if n_terms not in possible:
        raise InputError(
            f"terms is {n_terms}; the {samples.gait} has {possible.start} formulas of 1 to "
            f"{1 + LONGEST} terms, so ask for {possible.start} to {possible.stop - 1}"
        )
    grown = [_grow(part, fit) for part in parts]
    counts = allot([own.errors for growths in grown for own in growths], n_terms)
    formulas: dict[Place, Expression] = {}
    taken = iter(counts)
    for part, growths in zip(parts, grown, strict=True):
        state = part.places[0][0]
        sums = [
            settled(
                gated_expression(gates(fit.vocabulary), own.weights[count], own.intercepts[count]),
                names,
                state,
            )
            for own, count in zip(growths, taken, strict=False)
        ]
        values = fit.values(part.observations)
        formulas |= zip(part.places, readable(sums, values, part.targets), strict=True)
    if mirror is not None:
        formulas = FormulaMirror.of(fit.vocabulary, mirror).complete(formulas)
    return fit.policy(samples.gait, formulas, mirror)


def allot(errors: Sequence[Array], n_terms: int) -> list[int]:
    """Gives each formula as many terms as serve all of them best.

    Args:
        errors: Mean squared error of each formula after each number of terms (terms + 1).
        n_terms: Terms of all formulas together, the constant of each among them.

    Returns:
        Number of terms of each formula, its constant not counted.
    """
    counts = [0] * len(errors)
    left = n_terms - len(errors)
    while left > 0:
        # What a term gains at best, alone or with those that follow.
        gains = [
            max(
                (
                    ((own[count] - own[count + more]) / more, more)
                    for more in range(1, min(LOOKED_AHEAD, left, len(own) - 1 - count) + 1)
                ),
                default=(0.0, 0),
            )
            for own, count in zip(errors, counts, strict=True)
        ]
        best = max(range(len(gains)), key=lambda formula: gains[formula])
        gain, more = gains[best]
        if gain <= 0.0:
            break
        counts[best] += more
        left -= more
    return counts


def _grow(part: StateSamples, fit: FormulaFit) -> list[_Growth]:
    """Lets the formulas of a state grow term by term."""
    values = fit.values(part.observations)
    opened = Tape(gates(fit.vocabulary), values.shape[1])(values).T
    candidates = np.hstack([values, *(values * gate[:, None] for gate in opened)])
    mean, growths = candidates.mean(axis=0), []
    paths = weight_paths(candidates, part.targets, LONGEST)
    for target, path in zip(part.targets.T, paths, strict=True):
        intercepts = target.mean() - path @ mean
        predicted = candidates @ path.T + intercepts
        errors = ((predicted - target[:, None]) ** 2).mean(axis=0)
        growths.append(_Growth(path.reshape(len(path), len(opened) + 1, -1), intercepts, errors))
    return growths


@dataclass(frozen=True)
class SparseFormulaSettings(StudentSettings):
    """Settings of a page of formulas.

    Attributes:
        terms: Terms of all formulas together, the constant of each among them; a formula's mirror
            image costs none.
        mirrored: Whether formulas of one side are mirror images of the other's, where the gait's
            machine has a mirror image.
        alone_episodes: Episodes of a round in which the page acts alone.
    """

    title: ClassVar[str] = "distillation: sparse_formula"

    terms: Annotated[Count, Ge(12)] = 100
    mirrored: bool = True
    alone_episodes: Count = 13  # type: ignore[assignment]


def _fit(
    samples: TrainingSet, settings: SparseFormulaSettings, *, seed: int, n_jobs: int
) -> FormulaPolicy:
    return condense(samples, settings.terms, mirrored=settings.mirrored)


SPARSE_FORMULA = Student(
    "sparse_formula",
    "Page of formulas",
    _fit,
    color="#A87400",
    marker="*",
    settings=SparseFormulaSettings(),
    brevity=1,
)
