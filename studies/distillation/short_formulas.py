"""Short formula files: formulas with so many terms in all that a person reads them at one sitting.

Each term goes to the formula that it helps most; a mirror shares formulas between left and right.
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
"""Greatest number of terms of a formula without its constant."""

LOOKED_AHEAD = 4
"""Terms that are weighed together: two may help where one does not."""


@checked
class FormulasSettings(StudentSettings):
    """Settings of a short formula file.

    Attributes:
        terms: Terms of all formulas, with constants; mirror images cost none.
        mirrored: Whether formulas of one side are mirror images of the other's, where the gait's
            machine has a mirror image.
        alone_episodes: Episodes of a round in which the student acts without the expert.
    """

    title: ClassVar[str] = "distillation: formulas"

    terms: Annotated[Count, Ge(12)] = 100
    mirrored: bool = True
    alone_episodes: Count = 13  # type: ignore[assignment]

    def refuse_for(self, gait: Gait) -> None:
        """Refuses fewer terms than a gait has formulas, or more than they may have."""
        names = ObservationLayout(gait.n_states).names
        mirror = mirrored_states(gait) if self.mirrored else None
        n_formulas = len(written_places(Vocabulary(names), mirror))
        most = n_formulas * (1 + LONGEST)
        if not n_formulas <= self.terms <= most:
            raise InputError(
                f"formulas: terms is {self.terms}; the {gait.name} has {n_formulas} formulas "
                f"of 1 to {1 + LONGEST} terms, so ask for {n_formulas} to {most}"
            )


@dataclass(frozen=True)
class _Growth:
    """A formula after each number of terms: weights, constants, mean squared errors (rad²)."""

    weights: Array
    intercepts: Array
    errors: Array


def fit_short_formulas(
    samples: TrainingSet, settings: FormulasSettings, *, seed: int
) -> FormulaPolicy:
    """Fits the formulas of every joint and state of the machine with so many terms in all."""
    mirror = samples.mirror if settings.mirrored else None
    variables = FormulaVariables(samples.robot, samples.observation_names)
    vocabulary = variables.vocabulary
    opened = gates(vocabulary)

    # Grow all formulas, then give each its share of the terms.
    parts = samples_by_state(samples, vocabulary, mirror)
    grown = [_grow(part, variables(part.observations), opened) for part in parts]
    errors = [growth.errors for growths in grown for growth in growths]
    counts = iter(allot(errors, settings.terms))

    # Write each formula as it was when it had that many terms.
    formulas: dict[Place, Expression] = {}
    for part, growths in zip(parts, grown, strict=True):
        sums = []
        for growth in growths:
            count = next(counts)
            written = gated_expression(opened, growth.weights[count], growth.intercepts[count])
            sums.append(settled(written, vocabulary.names, part.places[0][0]))
        found = readable(sums, variables(part.observations), part.targets)
        formulas |= zip(part.places, found, strict=True)
    return formula_policy(samples, vocabulary, formulas, mirror)


def allot(errors: Sequence[Array], n_terms: int) -> list[int]:
    """Distributes terms, constants among them, and returns each formula's without its constant.

    Errors are the mean squares of each formula after each number of terms (terms + 1).
    """
    counts = [0] * len(errors)
    left = n_terms - len(errors)
    while left > 0:
        # The best gain of a term, by itself or with those that follow.
        gains = [
            max(
                (
                    ((path[count] - path[count + more]) / more, more)
                    for more in range(1, min(LOOKED_AHEAD, left, len(path) - 1 - count) + 1)
                ),
                default=(0.0, 0),
            )
            for path, count in zip(errors, counts, strict=True)
        ]

        # The formula that gains most gets the terms; where none gains, they are left over.
        best = max(range(len(gains)), key=lambda formula: gains[formula])
        gain, more = gains[best]
        if gain <= 0.0:
            break
        counts[best] += more
        left -= more
    return counts


def _grow(part: FormulaSamples, values: Array, opened: Sequence[Expression]) -> list[_Growth]:
    """Lets the formulas of a state grow term by term."""
    # Choose terms one after the other, and the constants that go with them.
    terms = PossibleTerms(values, Tape(opened, values.shape[1])(values))
    paths, mean = weight_paths(terms, part.targets, LONGEST), terms.moments[0]
    intercepts = [
        target.mean() - path @ mean for target, path in zip(part.targets.T, paths, strict=True)
    ]

    # Sum the squared errors after each term, block by block.
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
