"""Short formula files: formulas with a limited total number of terms, short enough to read.

By default, the formulas of a leg use only quantities of that leg and the trunk. Each term goes to
the formula that it improves most. If the gait is symmetric, only the formulas of one side are
written.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.formulas.evaluate import Tape
from glassgait.models.formulas.expression import Expression, plus, scaled, variable
from glassgait.models.formulas.mirror import Place
from glassgait.models.formulas.quantities import PHASES, Vocabulary
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
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
from glassgait.studies.distillation.gated_sum import (
    PENALTY,
    PossibleTerms,
    gated_expression,
    weight_paths,
)
from glassgait.studies.distillation.students import StudentSettings

OF_THE_TRUNK = (
    *("cmd.v", "cmd.yaw", "cmd.t", "v.x", "v.y", "v.z", "g.x", "g.y", "g.z", "w.x", "w.y", "w.z"),
    *(*PHASES, "e.v", "e.yaw"),
)
"""Symbols of the trunk and of the gait that a formula may use."""

OF_A_LEG = ("q", "dq", "a", "h", "x", "z")
"""Kinds of a leg's quantities that its formulas may use."""

FACTORS = (*PHASES, "cmd.v", "cmd.yaw", "g.x", "g.y", "v.y", "w.y")
"""Symbols whose products with other quantities are terms, too.

Without `g.x`, `v.y` and `w.y`, R² of a trot was 0.02 lower, and without `g.y` on slopes 0.01.
"""

REFLEX = "wait"
"""Symbol of the term that moves a joint while the robot waits."""

LOOK_AHEAD = 4
"""Greatest number of terms added in one step: two may help where one does not."""


@checked
class FormulasSettings(StudentSettings):
    """Settings of a short formula file.

    Attributes:
        terms: Number of terms of all formulas, with constants; mirror images do not count.
        longest: Greatest number of terms of a formula, with its constant.
        local: Whether the formulas of a leg use only this leg and the trunk. Otherwise they use all
            legs, and products with foot contacts and with sides of previous targets.
        reflexes: Whether each formula has the term `wait`, which a refinement can adjust until
            robots that wait lift their feet. Otherwise few have it, since experts seldom wait.
        mirrored: Whether formulas of one side are mirror images of the other's, if the gait's
            machine has a mirror image.
        alone_episodes: Episodes per round without the expert.
    """

    title: ClassVar[str] = "distillation: formulas"

    terms: Annotated[Count, Ge(12)] = 100
    longest: Count = 14
    local: bool = True
    reflexes: bool = False
    mirrored: bool = True
    alone_episodes: Count = 13  # type: ignore[assignment]

    def refuse_for(self, gait: Gait, symmetric: bool) -> None:
        """Raises an InputError if `terms` is too small or too great for the gait's formulas."""
        names = ObservationLayout(gait.n_states).names
        mirror = mirrored_states(gait) if self.mirrored and symmetric else None
        n_formulas = len(written_places(Vocabulary(names), mirror))
        if self.reflexes and not gait.transitions:
            raise InputError(
                f"formulas: reflexes is true, but robots never wait in gait {gait.name}; set false"
            )
        longest = max(self.longest, 1 + self.reflexes)
        least, most = n_formulas * (1 + self.reflexes), n_formulas * longest
        if not least <= self.terms <= most:
            raise InputError(
                f"formulas: terms is {self.terms}; the {gait.name} has {n_formulas} formulas "
                f"of {1 + self.reflexes} to {longest} terms, so set {least} to {most}"
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
    factors = [vocabulary.variable(symbol) for symbol in FACTORS if symbol in vocabulary.symbols]
    if not settings.local:
        factors = [*gates(vocabulary)]

    # Fit all formulas at every length, then allot the terms.
    groups = samples_by_state(samples, vocabulary, mirror)
    grown = [_grow(group, variables, factors, settings) for group in groups]
    errors = [growth.errors for growths in grown for growth in growths]
    n_reflexes = len(errors) if settings.reflexes else 0
    counts = iter(allot(errors, settings.terms - n_reflexes))
    reflex = vocabulary.symbols.index(REFLEX)

    # Write each formula with its number of terms.
    formulas: dict[Place, Expression] = {}
    for group, growths in zip(groups, grown, strict=True):
        values, sums = variables(group.observations), []
        for growth, target in zip(growths, group.targets.T, strict=True):
            n = next(counts)
            formula = gated_expression(factors, growth.weights[n], growth.intercepts[n])
            if settings.reflexes and growth.weights[n][0, reflex] == 0.0:
                # Give it the weight that predicts best what the other terms leave over.
                waits = values[:, reflex] - values[:, reflex].mean()
                left = target - Tape([formula], values.shape[1])(values)[:, 0]
                weight = left @ waits / (waits @ waits + PENALTY * len(waits))
                formula = plus(formula, scaled(variable(reflex), weight))
            sums.append(settled(formula, vocabulary.names, group.places[0][0]))
        rounded = readable(sums, values, group.targets)
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


def _grow(
    group: FormulaSamples,
    variables: FormulaVariables,
    factors: Sequence[Expression],
    settings: FormulasSettings,
) -> list[_Growth]:
    """Fits the formulas of an RM state term by term; those of a leg share their possible terms."""
    values = variables(group.observations)
    gates, grown = Tape(factors, values.shape[1])(values), list[_Growth]()
    for leg, places in groupby(group.places, lambda place: _leg(place) if settings.local else None):
        # Choose the terms, and the constant for each number of terms.
        used = variables_of(leg, variables.vocabulary)
        terms = PossibleTerms(values[:, used], gates)
        targets = group.targets[:, len(grown) : len(grown) + len([*places])]
        most = max(0, settings.longest - 1 - settings.reflexes)
        paths, mean = weight_paths(terms, targets, most), terms.moments[0]
        biases = [
            target.mean() - path @ mean for target, path in zip(targets.T, paths, strict=True)
        ]

        # Sum the squared errors for each number of terms, block by block.
        squares = [np.zeros(len(path)) for path in paths]
        for rows, block in terms.blocks():
            fits = zip(paths, biases, targets[rows].T, strict=True)
            for i, (path, bias, target) in enumerate(fits):
                squares[i] += ((block @ path.T + bias - target[:, None]) ** 2).sum(axis=0)
        for path, bias, total in zip(paths, biases, squares, strict=True):
            weights = np.zeros((len(path), 1 + len(factors), values.shape[1]))
            weights[..., used] = path.reshape(len(path), -1, len(used))
            grown.append(_Growth(weights, bias, total / len(values)))
    return grown


def _leg(place: Place) -> str:
    return quadruped.LEGS[place[-1] // len(quadruped.LEG_JOINTS)]


def variables_of(leg: str | None, vocabulary: Vocabulary) -> list[int]:
    """Returns the indices of the variables that formulas of a leg may use; all without a leg."""

    def allowed(symbol: str) -> bool:
        kind, _, part = symbol.partition(".")
        return symbol in OF_THE_TRUNK or (kind in OF_A_LEG and part.partition("_")[0] == leg)

    symbols = vocabulary.symbols
    return [i for i, symbol in enumerate(symbols) if leg is None or allowed(symbol)]
