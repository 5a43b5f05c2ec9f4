"""Short formula files: formulas with a limited total number of terms, short enough to read.

Each term goes to the formula that it improves most. If the gait is symmetric, only the formulas of
one side are written.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.formulas.evaluate import Tape
from glassgait.models.formulas.expression import Expression
from glassgait.models.formulas.mirror import Place
from glassgait.models.formulas.quantities import Vocabulary
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.settings import Count, checked
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import ObservationLayout
from glassgait.models.task.symmetry import mirrored_states
from glassgait.studies.distillation.dataset import TrainingSet
from glassgait.studies.distillation.formulas import (
    FormulaSamples,
    FormulaVariables,
    formula_policy,
    gates,
    readable,
    samples_by_state,
    settled,
    written_places,
)
from glassgait.studies.distillation.gated_sum import PossibleTerms, gated_expression, weight_paths
from glassgait.studies.distillation.students import StudentSettings

LONGEST = 40
"""Greatest number of terms of a formula, without its constant."""

LOOK_AHEAD = 4
"""Greatest number of terms added in one step: two may help where one does not."""


@checked
class FormulasSettings(StudentSettings):
    """Settings of a short formula file.

    Attributes:
        terms: Number of terms of all formulas, with constants; mirror images do not count.
        mirrored: Whether formulas of one side are mirror images of the other's, if the gait's
            machine has a mirror image.
        alone_episodes: Episodes per round without the expert.
    """

    title: ClassVar[str] = "distillation: formulas"

    terms: Annotated[Count, Ge(12)] = 100
    mirrored: bool = True
    alone_episodes: Count = 13  # type: ignore[assignment]

    def refuse_for(self, gait: Gait) -> None:
        """Raises an InputError if `terms` is too small or too great for the gait's formulas."""
        names = ObservationLayout(gait.n_states).names
        mirror = mirrored_states(gait) if self.mirrored else None
        n_formulas = len(written_places(Vocabulary(names), mirror))
        most = n_formulas * (1 + LONGEST)
        if not n_formulas <= self.terms <= most:
            raise InputError(
                f"formulas: terms is {self.terms}; the {gait.name} has {n_formulas} formulas "
                f"of 1 to {1 + LONGEST} terms, so set {n_formulas} to {most}"
            )


@dataclass(frozen=True)
class _Growth:
    """One formula at 0, 1, 2, … terms: weights, constants, mean squared errors (rad²)."""

    weights: Array
    intercepts: Array
    errors: Array


def fit_short_formulas(
    samples: TrainingSet, settings: FormulasSettings, *, seed: int
) -> FormulaPolicy:
    """Fits one formula per joint and RM state, with `terms` terms in total."""
    mirror = samples.mirror if settings.mirrored else None
    variables = FormulaVariables(samples.robot, samples.observation_names)
    vocabulary = variables.vocabulary
    state_gates = gates(vocabulary)

    # Fit all formulas at every length, then allot the terms.
    groups = samples_by_state(samples, vocabulary, mirror)
    grown = [_grow(group, variables(group.observations), state_gates) for group in groups]
    errors = [growth.errors for growths in grown for growth in growths]
    counts = iter(allot(errors, settings.terms))

    # Write each formula with its number of terms.
    formulas: dict[Place, Expression] = {}
    for group, growths in zip(groups, grown, strict=True):
        sums = []
        for growth in growths:
            n = next(counts)
            formula = gated_expression(state_gates, growth.weights[n], growth.intercepts[n])
            sums.append(settled(formula, vocabulary.names, group.places[0][0]))
        rounded = readable(sums, variables(group.observations), group.targets)
        formulas |= zip(group.places, rounded, strict=True)
    return formula_policy(samples, vocabulary, formulas, mirror)


def allot(errors: Sequence[Array], n_terms: int) -> list[int]:
    """Distributes `n_terms` terms among formulas; returns the number of terms of each.

    Each formula's constant counts as one of `n_terms`, but not in the result. `errors` has the mean
    squared errors (terms + 1) of each formula at 0, 1, 2, … terms.
    """
    counts = [0] * len(errors)
    left = n_terms - len(errors)
    while left > 0:
        # Each formula's best gain per term, by the next term or the next few.
        gains = [
            max(
                (
                    ((path[count] - path[count + more]) / more, more)
                    for more in range(1, min(LOOK_AHEAD, left, len(path) - 1 - count) + 1)
                ),
                default=(0.0, 0),
            )
            for path, count in zip(errors, counts, strict=True)
        ]

        # The formula that gains most gets the terms. If no formula gains, terms are left over.
        best = max(range(len(gains)), key=lambda formula: gains[formula])
        gain, more = gains[best]
        if gain <= 0.0:
            break
        counts[best] += more
        left -= more
    return counts


def _grow(group: FormulaSamples, values: Array, state_gates: Sequence[Expression]) -> list[_Growth]:
    """Fits the formulas of an RM state term by term."""
    # Choose the terms, and the constant for each number of terms.
    terms = PossibleTerms(values, Tape(state_gates, values.shape[1])(values))
    paths, mean = weight_paths(terms, group.targets, LONGEST), terms.moments[0]
    intercepts = [
        target.mean() - path @ mean for target, path in zip(group.targets.T, paths, strict=True)
    ]

    # Sum the squared errors for each number of terms, block by block.
    squares = [np.zeros(len(path)) for path in paths]
    for rows, block in terms.blocks():
        errors = (
            block @ path.T + bias - target[:, None]
            for path, bias, target in zip(paths, intercepts, group.targets[rows].T, strict=True)
        )
        squares = [
            total + (error**2).sum(axis=0) for total, error in zip(squares, errors, strict=True)
        ]
    return [
        _Growth(path.reshape(len(path), -1, values.shape[1]), bias, total / len(values))
        for path, bias, total in zip(paths, intercepts, squares, strict=True)
    ]
