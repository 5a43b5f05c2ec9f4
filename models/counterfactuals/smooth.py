"""A joint's target as a smooth function of the free observations, with bounds of its slopes."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import cast

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.counterfactuals.intervals import bounds_of, with_values
from glassgait.models.counterfactuals.question import Question
from glassgait.models.formulas.expression import Expression
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.policies.linear import LinearPolicy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.task.observation import indices_of


class SmoothTarget(ABC):
    """By how much a joint's target goes the way that was asked, as the free observations move.

    Some observations are *curved*. Where these stand still, the target is affine in all others.
    Moves are counted in spreads, from what was observed.

    Attributes:
        size: Number of free observations, k.
        curved: Which of these are curved (c).
    """

    size: int
    curved: NDArray[np.intp]

    @abstractmethod
    def rise(self, curved: Array) -> Array:
        """Returns the rise (m; rad) where the curved observations have moved (m, c), none else."""

    @abstractmethod
    def slopes(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Bounds the slope along each free observation (m, k; rad a spread).

        Args:
            low: Least moves of the curved observations, of m boxes (m, c).
            high: Greatest moves (m, c).

        Returns:
            Least and greatest slopes; those along curved ones where all others stand still.
        """


class AffineTarget(SmoothTarget):
    """The target of a linear law: no observation is curved."""

    def __init__(self, question: Question) -> None:
        policy, room = cast(LinearPolicy, question.policy), question.room
        if policy.weights.ndim == 3:
            one_hot = list(indices_of("machine state", policy.observation_names))
            state = int(np.argmax(question.observation[one_hot]))
            weights = policy.weights[state, question.joint]
        else:
            weights = policy.weights[question.joint]
        scale = question.sign * question.policy.robot.action_scale
        self._slopes = scale * (weights * room.spread)[room.free]
        self.size = len(room.free)
        self.curved = np.zeros(0, dtype=np.intp)

    def rise(self, curved: Array) -> Array:
        return np.zeros(len(curved))

    def slopes(self, low: Array, high: Array) -> tuple[Array, Array]:
        own = np.broadcast_to(self._slopes, (len(low), self.size))
        return own, own


class FormulaTarget(SmoothTarget):
    """The target of a formula, that of the machine's state."""

    def __init__(self, question: Question) -> None:
        policy, room = cast(FormulaPolicy, question.policy), question.room
        names = policy.observation_names
        units = RobotUnits.of(policy.robot, names)
        self._here = units.quantities(question.observation)
        self._spread = (room.spread / units.scale)[room.free]
        self._free = room.free.tolist()
        self._sign = question.sign
        self.size = len(self._free)
        formulas = policy.formulas_by_state
        one_hot = list(indices_of("machine state", names))
        state = int(np.argmax(question.observation[one_hot])) if len(formulas) > 1 else 0
        held = {
            index: float(self._here[index])
            for index in range(len(names))
            if index not in set(self._free)
        }
        formula = with_values(policy.vocabulary.expanded(formulas[state][question.joint]), held)
        slopes = {index: formula.derivative(index) for index in sorted(formula.variables)}
        curved = _curved(slopes)
        self.curved = np.array([self._free.index(index) for index in curved], dtype=np.intp)
        here = {index: float(self._here[index]) for index in formula.variables}
        still = {index: value for index, value in here.items() if index not in curved}
        # Others stand still where a curved observation moves: what they then add has slopes of
        # its own, which hold none but curved observations.
        self._formula = with_values(formula, still)
        self._before = float(bounds_of(with_values(formula, here), {})[0])
        self._slopes = {
            self._free.index(index): with_values(slope, still) for index, slope in slopes.items()
        }

    def rise(self, curved: Array) -> Array:
        value, _ = bounds_of(self._formula, self._boxes(curved, curved))
        return self._sign * (np.broadcast_to(value, len(curved)) - self._before)

    def slopes(self, low: Array, high: Array) -> tuple[Array, Array]:
        boxes = self._boxes(low, high)
        least, greatest = np.zeros((2, len(low), self.size))
        for place, slope in self._slopes.items():
            scale = self._sign * self._spread[place]
            ends = [scale * end for end in bounds_of(slope, boxes)]
            least[:, place], greatest[:, place] = np.minimum(*ends), np.maximum(*ends)
        return least, greatest

    def _boxes(self, low: Array, high: Array) -> dict[int, tuple[Array, Array]]:
        boxes = {}
        for column, place in enumerate(self.curved.tolist()):
            index, spread = self._free[place], self._spread[place]
            here = self._here[index]
            boxes[index] = here + spread * low[:, column], here + spread * high[:, column]
        return boxes


def _curved(slopes: dict[int, Expression]) -> Sequence[int]:
    """Chooses variables without which a formula is affine, few of them.

    Args:
        slopes: The formula's slope along each of its variables.
    """
    meets = {index: set(slope.variables) for index, slope in slopes.items()}
    # Whose slope holds itself is curved by itself; of two that multiply each other one will do.
    chosen = {index for index, others in meets.items() if index in others}
    while True:
        left = {
            index: others - chosen - {index}
            for index, others in meets.items()
            if index not in chosen
        }
        most = max(left, key=lambda index: len(left[index]), default=None)
        if most is None or not left[most]:
            return sorted(chosen)
        chosen.add(most)
