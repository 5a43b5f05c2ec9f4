"""Formulas in a mirror that exchanges left and right."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

from glassgait.models.errors import InputError
from glassgait.models.formulas.expression import Expression, canonical, negative, variable
from glassgait.models.formulas.quantities import Vocabulary
from glassgait.models.task.symmetry import REFLECT_JOINTS, reflect_observation

Place = tuple[int, ...]
"""Where a formula stands: state and joint, or the joint alone."""


@dataclass(frozen=True)
class FormulaMirror:
    """Maps formulas to their mirror images.

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

        Raises:
            InputError: if an observation's name is unknown, or a definition has no mirror image.
        """
        reflection = reflect_observation(vocabulary.names, states)
        observed = tuple(
            _signed(variable(index), sign)
            for index, sign in zip(reflection.index.tolist(), reflection.sign, strict=True)
        )
        images = dict(enumerate(observed))
        formulas = [definition.formula for definition in vocabulary.definitions]
        defined = []
        for definition in vocabulary.definitions:
            image = canonical(definition.formula.replaced(images))
            sign = 1.0 if image in formulas else -1.0
            own = image if sign > 0.0 else negative(image)
            if own not in formulas:
                raise InputError(
                    f"{definition.symbol} has no mirror image among the definitions; define it too"
                )
            place = len(vocabulary.names) + formulas.index(own)
            defined.append(_signed(variable(place), sign))
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


def _signed(formula: Expression, sign: float) -> Expression:
    return formula if sign > 0.0 else Expression("neg", (formula,))
