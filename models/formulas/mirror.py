"""Formulas in a mirror that exchanges left and right."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Self

from glassgait.models.formulas.expression import Expression, canonical, negative, variable
from glassgait.models.formulas.quantities import Definition, Vocabulary
from glassgait.models.task.observation import MIRRORED_LEGS, REFLECT_JOINTS, reflect_observation

Place = tuple[int, ...]
"""Where a formula stands: state and joint, or the joint alone."""


@dataclass(frozen=True)
class FormulaMirror:
    """Maps formulas to their mirror images.

    What a formula calls by a name is called in the mirror by that of its image, where that is
    defined, and else stands there in full.

    Attributes:
        states: State of the machine that each state is in the mirror (n_states).
        variables: What each variable is in the mirror (n).
    """

    states: tuple[int, ...]
    variables: tuple[Expression, ...]

    @classmethod
    def of(cls, vocabulary: Vocabulary, states: Sequence[int]) -> Self:
        """Returns the mirror of formulas.

        Args:
            vocabulary: What their variables are.
            states: State that each state of the machine is in the mirror, its own inverse.
        """
        # The image of a definition is another definition, the negative of one, or stands in full.
        observed = _observed(vocabulary.names, states)
        images = dict(enumerate(observed))
        formulas = [definition.formula for definition in vocabulary.definitions]
        defined = []
        for definition in vocabulary.definitions:
            image = canonical(definition.formula.replaced(images))
            opposite = negative(image)
            if image in formulas:
                defined.append(variable(len(vocabulary.names) + formulas.index(image)))
            elif opposite in formulas:
                place = len(vocabulary.names) + formulas.index(opposite)
                defined.append(_signed(variable(place), -1.0))
            else:
                defined.append(image)
        return cls(tuple(states), (*observed, *defined))

    def place(self, place: Place) -> Place:
        """Returns where a formula's image stands; a joint's never is its own."""
        *state, joint = place
        return (*(self.states[index] for index in state), int(REFLECT_JOINTS.index[joint]))

    def formula(self, formula: Expression, joint: int) -> Expression:
        """Returns the image of a joint's formula, in canonical form."""
        image = canonical(formula.replaced(dict(enumerate(self.variables))))
        return negative(image) if REFLECT_JOINTS.sign[joint] < 0.0 else image

    def complete(self, formulas: Mapping[Place, Expression]) -> dict[Place, Expression]:
        """Adds the images of formulas whose images are not given."""
        images = {
            self.place(place): self.formula(formula, place[-1])
            for place, formula in formulas.items()
        }
        return {**images, **formulas}


def completed(
    names: Sequence[str], states: Sequence[int], given: Sequence[Definition]
) -> tuple[Definition, ...]:
    """Adds the images of definitions of a leg whose images are not given.

    They stand behind those of the same leg: what is given of FL, of FR, of RL, of RR.

    Args:
        names: Names of the observations (n).
        states: State that each state of the machine is in the mirror.
        given: The definitions.
    """
    images = dict(enumerate(_observed(names, states)))
    known = {definition.symbol for definition in given}
    whole: list[Definition] = []
    # Definitions of a leg stand together, and their images follow them.
    for _, group in groupby(given, _leg):
        own = list(group)
        whole += own
        for definition in own:
            symbol = _image_symbol(definition)
            if symbol not in known:
                formula = canonical(definition.formula.replaced(images))
                whole.append(replace(definition, symbol=symbol, formula=formula))
    return tuple(whole)


def without_images(
    names: Sequence[str], states: Sequence[int], definitions: Sequence[Definition]
) -> tuple[Definition, ...]:
    """Leaves out definitions of right legs, where `completed` adds the same again."""
    kept = tuple(own for own in definitions if _leg(own) not in _RIGHT)
    return kept if completed(names, states, kept) == tuple(definitions) else tuple(definitions)


_RIGHT = ("FR", "RR")


def _observed(names: Sequence[str], states: Sequence[int]) -> tuple[Expression, ...]:
    """Returns what each observed quantity is in the mirror."""
    reflection = reflect_observation(names, states)
    images = zip(reflection.index.tolist(), reflection.sign, strict=True)
    return tuple(_signed(variable(index), sign) for index, sign in images)


def _leg(definition: Definition) -> str:
    """Returns the leg that a definition's name ends with, such as lifted.FL or sent.FL_hip."""
    leg = definition.symbol.partition(".")[2].partition("_")[0]
    return leg if leg in MIRRORED_LEGS else ""


def _image_symbol(definition: Definition) -> str:
    """Returns what the image of a definition is called: sent.FR_hip is that of sent.FL_hip."""
    leg = _leg(definition)
    return (
        definition.symbol.replace(f".{leg}", f".{MIRRORED_LEGS[leg]}") if leg else definition.symbol
    )


def _signed(formula: Expression, sign: float) -> Expression:
    return formula if sign > 0.0 else Expression("neg", (formula,))
