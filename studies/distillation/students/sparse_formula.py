"""A page of formulas: so few terms in all that a person reads them at one sitting.

Each term goes to the formula that it helps most; a mirror shares formulas between left and right.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.formulas.expression import Expression
from glassgait.models.formulas.mirror import Place
from glassgait.models.formulas.quantities import Vocabulary
from glassgait.models.formulas.tape import Tape
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.settings import Count, checked
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import ObservationLayout
from glassgait.models.task.symmetry import mirrored_states
from glassgait.studies.distillation.students.formula_samples import (
    FormulaSamples,
    samples_by_state,
    written_places,
)
from glassgait.studies.distillation.students.gated_sum import (
    PossibleTerms,
    gated_expression,
    weight_paths,
)
from glassgait.studies.distillation.students.student import Student, StudentSettings, TrainingSet
from glassgait.studies.distillation.students.symbolic import FormulaFit, gates, readable, settled

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


def _refuse_terms(n_terms: int, gait: str, n_formulas: int) -> None:
    possible = possible_terms(n_formulas)
    if n_terms not in possible:
        raise InputError(
            f"a page: terms is {n_terms}; the {gait} has {n_formulas} formulas of 1 to "
            f"{1 + LONGEST} terms, so ask for {possible.start} to {possible.stop - 1}"
        )


def condense(
    samples: TrainingSet, sizes: Sequence[int], *, mirrored: bool
) -> dict[int, FormulaPolicy]:
    """Fits the formulas of every joint and state of the machine with so many terms in all.

    A term is a number times quantities; a formula's constant is one. Mirror images cost none.
    Formulas grow once, of which every size is a stage.

    Args:
        samples: What robots observed, and what the expert would do.
        sizes: Numbers of terms, one for each formula at least.
        mirrored: Whether the formulas of one side are mirror images of the other's, where the
            gait's machine has a mirror image.

    Returns:
        The policy of each size.

    Raises:
        InputError: if there are fewer terms than formulas, or more than formulas may have.
    """
    mirror = samples.mirror if mirrored else None
    fit = FormulaFit(samples.robot, samples.observation_names, gates)
    parts = samples_by_state(samples, fit.vocabulary, mirror)
    for n_terms in sizes:
        _refuse_terms(n_terms, samples.gait, sum(len(part.places) for part in parts))
    grown = [_grow(part, fit) for part in parts]
    errors = [own.errors for growths in grown for own in growths]
    counts = {n_terms: iter(allot(errors, n_terms)) for n_terms in sizes}
    formulas: dict[int, dict[Place, Expression]] = {n_terms: {} for n_terms in sizes}
    for part, growths in zip(parts, grown, strict=True):
        values = fit.values(part.observations)
        for n_terms, taken in counts.items():
            sums = [
                _stage(own, fit, count, part.places[0][0])
                for own, count in zip(growths, taken, strict=False)
            ]
            found = readable(sums, values, part.targets)
            formulas[n_terms] |= zip(part.places, found, strict=True)
    return {n_terms: fit.policy(samples.gait, own, mirror) for n_terms, own in formulas.items()}


def _stage(growth: _Growth, fit: FormulaFit, count: int, state: int) -> Expression:
    """Writes a formula of a state as it was when it had so many terms and a constant."""
    weights, intercept = growth.weights[count], growth.intercepts[count]
    own = gated_expression(gates(fit.vocabulary), weights, intercept)
    return settled(own, fit.vocabulary.names, state)


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


def _grow(part: FormulaSamples, fit: FormulaFit) -> list[_Growth]:
    """Lets the formulas of a state grow term by term."""
    values = fit.values(part.observations)
    terms = PossibleTerms(values, Tape(gates(fit.vocabulary), values.shape[1])(values))
    paths, mean = weight_paths(terms, part.targets, LONGEST), terms.moments[0]
    intercepts = [
        target.mean() - path @ mean for target, path in zip(part.targets.T, paths, strict=True)
    ]
    squares = [np.zeros(len(path)) for path in paths]
    for rows, block in terms.blocks():
        errors = (
            block @ path.T + rest - target[:, None]
            for path, rest, target in zip(paths, intercepts, part.targets[rows].T, strict=True)
        )
        squares = [
            total + (error**2).sum(axis=0) for total, error in zip(squares, errors, strict=True)
        ]
    return [
        _Growth(path.reshape(len(path), -1, values.shape[1]), rest, total / len(values))
        for path, rest, total in zip(paths, intercepts, squares, strict=True)
    ]


@checked
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

    def refuse_for(self, gait: Gait) -> None:
        """Refuses fewer terms than a gait's formulas, or more than they may have."""
        vocabulary = Vocabulary(ObservationLayout(gait.n_states).names)
        mirror = mirrored_states(gait) if self.mirrored else None
        _refuse_terms(self.terms, gait.name, len(written_places(vocabulary, mirror)))


def _fit(
    samples: TrainingSet, settings: SparseFormulaSettings, *, seed: int, n_jobs: int
) -> FormulaPolicy:
    return condense(samples, [settings.terms], mirrored=settings.mirrored)[settings.terms]


SPARSE_FORMULA = Student(
    "sparse_formula",
    "Page of formulas",
    _fit,
    color="#A87400",
    marker="*",
    settings=SparseFormulaSettings(),
    brevity=1,
)
