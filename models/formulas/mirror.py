"""Formulas in a mirror that exchanges left and right."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Self

from glassgait.models.formulas.expression import Expression, canonical, negative, variable
from glassgait.models.formulas.quantities import Definition, Vocabulary
from glassgait.models.task.observation import MIRRORED_LEGS, REFLECT_JOINTS, reflect_observation

Place = tuple[int, ...]
"""State and joint of a formula, or only the joint if all states share the formula."""


@dataclass(frozen=True)
class FormulaMirror:
    """Maps formulas to their mirror images.

    The image of a definition is a definition, the negative of one, or else a whole formula.

    Attributes:
        states: Mirror image of each RM state (n_states).
        variables: Mirror image of each variable (n).
    """

    states: tuple[int, ...]
    variables: tuple[Expression, ...]

    @classmethod
    def of(cls, vocabulary: Vocabulary, states: Sequence[int]) -> Self:
        observed, n = observed_images(vocabulary.names, states), len(vocabulary.names)
        formulas = [definition.formula for definition in vocabulary.definitions]
        defined = []
        for formula in formulas:
            image = canonical(formula.replaced(dict(enumerate(observed))))
            if image in formulas:
                image = variable(n + formulas.index(image))
            elif (opposite := negative(image)) in formulas:
                image = Expression("neg", (variable(n + formulas.index(opposite)),))
            defined.append(image)
        return cls(tuple(states), (*observed, *defined))

    def place(self, place: Place) -> Place:
        """Returns the place of a formula's mirror image, which is always another joint."""
        *state, joint = place
        return (*(self.states[index] for index in state), int(REFLECT_JOINTS.index[joint]))

    def formula(self, formula: Expression, joint: int) -> Expression:
        """Returns the image of a joint's formula, in canonical form."""
        image = canonical(formula.replaced(dict(enumerate(self.variables))))
        return negative(image) if REFLECT_JOINTS.sign[joint] < 0.0 else image

    def complete(self, formulas: Mapping[Place, Expression]) -> dict[Place, Expression]:
        """Adds the mirror images that are missing."""
        images = {
            self.place(place): self.formula(formula, place[-1])
            for place, formula in formulas.items()
        }
        return {**images, **formulas}


def completed(
    names: Sequence[str], states: Sequence[int], given: Sequence[Definition]
) -> tuple[Definition, ...]:
    """Adds the missing mirror images of definitions of legs, after the definitions of each leg."""
    images = dict(enumerate(observed_images(names, states)))
    known = {definition.symbol for definition in given}
    whole: list[Definition] = []
    for leg, group in groupby(given, _leg):
        definitions = list(group)
        whole += definitions
        for definition in definitions if leg else ():
            symbol = definition.symbol.replace(f".{leg}", f".{MIRRORED_LEGS[leg]}")
            if symbol not in known:
                formula = canonical(definition.formula.replaced(images))
                whole.append(replace(definition, symbol=symbol, formula=formula))
    return tuple(whole)


def without_images(
    names: Sequence[str], states: Sequence[int], definitions: Sequence[Definition]
) -> tuple[Definition, ...]:
    """Leaves out the definitions of right legs if `completed` adds the same ones again."""
    shortened = [definition for definition in definitions if not _leg(definition).endswith("R")]
    whole = tuple(definitions)
    return tuple(shortened) if completed(names, states, shortened) == whole else whole


def observed_images(names: Sequence[str], states: Sequence[int]) -> tuple[Expression, ...]:
    """Returns the mirror image of each observation (n), as a formula."""
    reflection = reflect_observation(names, states)
    images = map(variable, reflection.index.tolist())
    return tuple(
        image if sign > 0.0 else Expression("neg", (image,))
        for image, sign in zip(images, reflection.sign, strict=True)
    )


def _leg(definition: Definition) -> str:
    """Returns the leg in the name of a definition, such as lifted.FL or sent.FL_hip, or ""."""
    leg = definition.symbol.partition(".")[2].partition("_")[0]
    return leg if leg in MIRRORED_LEGS else ""
