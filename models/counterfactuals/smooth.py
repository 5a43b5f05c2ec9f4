"""The nearest answer on a smooth target, by branch and bound over its curved observations."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import combinations, product
from typing import cast

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.branch_and_bound import Cells, greatest_bound
from glassgait.models.counterfactuals.question import (
    TOLERANCE,
    Answer,
    Question,
    Room,
    answered,
    moved,
)
from glassgait.models.formulas.expression import Expression, constant, plus, times, variable
from glassgait.models.formulas.interval import Interval, bounds_of
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.formulas.tape import Tape
from glassgait.models.policies.linear import LinearPolicy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.task.observation import indices_of

_BATCH = 128
"""Boxes that are bounded at once."""

_MOST_BATCHES = 300
"""Batches after which the search ends with the gap that it then has."""

_GRID = 4
"""Points of each curved observation where the most that can be reached is looked for."""


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
    def gradient(self, curved: Array) -> Array:
        """Returns the slope along each free observation (m, k; rad a spread) there.

        Those along curved ones are slopes where all others stand still.
        """

    @abstractmethod
    def slopes(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Bounds the gradient (m, k) over moves of the curved ones from low to high (m, c)."""


class AffineTarget(SmoothTarget):
    """The target of a linear law: no observation is curved."""

    def __init__(self, question: Question) -> None:
        policy, room = cast(LinearPolicy, question.policy), question.room
        by_state = policy.weights if policy.weights.ndim == 3 else policy.weights[None]
        weights = by_state[_state(question, len(by_state)), question.joint]
        scale = question.sign * question.policy.robot.action_scale
        self._slopes = scale * (weights * room.spread)[room.free]
        self.size = len(room.free)
        self.curved = np.zeros(0, dtype=np.intp)

    def rise(self, curved: Array) -> Array:
        return np.zeros(len(curved))

    def gradient(self, curved: Array) -> Array:
        return np.broadcast_to(self._slopes, (len(curved), self.size))

    def slopes(self, low: Array, high: Array) -> tuple[Array, Array]:
        return self.gradient(low), self.gradient(high)


class FormulaTarget(SmoothTarget):
    """The target of a formula, that of the machine's state."""

    def __init__(self, question: Question) -> None:
        policy, room = cast(FormulaPolicy, question.policy), question.room
        units = RobotUnits.of(policy.robot, policy.observation_names)
        here = policy.quantities(question.observation)[: len(policy.observation_names)]
        free = room.free.tolist()
        spread = (room.spread / units.scale)[room.free]
        formulas = policy.formulas_by_state
        written = formulas[_state(question, len(formulas))][question.joint]
        held = {*range(len(here))} - {*free}
        formula = with_values(policy.vocabulary.expanded(written), held, here)
        slopes = {index: formula.derivative(index) for index in sorted(formula.variables)}
        curved = _curved(slopes)
        self.size = len(free)
        self.curved = np.array([free.index(index) for index in curved], dtype=np.intp)
        # Others stand still where a curved observation moves: what they then add has slopes of
        # its own, which hold none but curved observations.
        columns = {index: variable(column) for column, index in enumerate(curved)}
        formula, *self._bounded = (
            with_values(own, {*range(len(here))} - {*curved}, here).replaced(columns)
            for own in (formula, *slopes.values())
        )
        self._along = [free.index(index) for index in slopes]
        self._scales = question.sign * spread[self._along]
        self._here, self._spread = here[list(curved)], spread[self.curved]
        self._tape = Tape([formula], len(curved))
        self._gradient = Tape(self._bounded, len(curved))
        self._sign, self._before = question.sign, float(self._tape(self._here)[0])

    def rise(self, curved: Array) -> Array:
        return self._sign * (self._tape(self._there(curved))[:, 0] - self._before)

    def gradient(self, curved: Array) -> Array:
        whole = np.zeros((len(curved), self.size))
        whole[:, self._along] = self._scales * self._gradient(self._there(curved))
        return whole

    def slopes(self, low: Array, high: Array) -> tuple[Array, Array]:
        ends = self._there(low), self._there(high)
        boxes = {i: Interval(ends[0][:, i], ends[1][:, i]) for i in range(len(self.curved))}
        least, greatest = np.zeros((2, len(low), self.size))
        for place, scale, slope in zip(self._along, self._scales, self._bounded, strict=True):
            found = bounds_of(slope, boxes).scaled(scale)
            least[:, place], greatest[:, place] = found.lower, found.upper
        return least, greatest

    def _there(self, moves: Array) -> Array:
        """Returns the curved quantities (m, c) after moves."""
        return self._here + self._spread * moves


def with_values(formula: Expression, held: Iterable[int], values: Array) -> Expression:
    """Puts numbers in for the variables that are held, and works out what holds no other."""
    held = frozenset(held)
    if formula.operator == "constant":
        return formula
    if formula.variables <= held:
        return constant(float(Tape([formula], len(values))(values)[0]))
    if formula.operator == "variable":
        return formula
    operands = tuple(with_values(operand, held, values) for operand in formula.operands)
    # What is multiplied by 0 is gone, whatever bounds it has.
    simple = {"add": plus, "mul": times}.get(formula.operator)
    return simple(*operands) if simple else Expression(formula.operator, operands)


def _room_in_range(question: Question) -> Room:
    """Leaves out of a room what a formula does not read; what it reads at an end is held."""
    policy, room = cast(FormulaPolicy, question.policy), question.room
    if policy.readings is None:
        return room
    units = RobotUnits.of(policy.robot, policy.observation_names)
    low, high = map(units.observed, policy.readings.ends(policy.observation_names))
    inside = (question.observation > low) & (question.observation < high)
    return Room(
        np.where(inside, room.spread, 0.0),
        np.maximum(room.lower, low),
        np.minimum(room.upper, high),
    )


def _state(question: Question, count: int) -> int:
    """Returns the machine's state where a policy has laws of each, else 0."""
    if count == 1:
        return 0
    one_hot = list(indices_of("machine state", question.policy.observation_names))
    return int(np.argmax(question.observation[one_hot]))


def _curved(slopes: Mapping[int, Expression]) -> Sequence[int]:
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


class SmoothSearch:
    """Looks for the nearest answer among those that move no more than some observations."""

    def __init__(self, question: Question, target: SmoothTarget) -> None:
        self._question, self._target = question, target
        self._down, self._up = question.room.limits(question.observation)
        self._ends = self._down[target.curved], self._up[target.curved]

    @classmethod
    def of_linear(cls, question: Question) -> "SmoothSearch":
        """Searches a linear law."""
        return cls(question, AffineTarget(question))

    @classmethod
    def of_formula(cls, question: Question) -> "SmoothSearch":
        """Searches a formula, within the ranges in which it reads what is sensed."""
        question = replace(question, room=_room_in_range(question))
        return cls(question, FormulaTarget(question))

    def nearest(self, masks: NDArray[np.bool_] | None = None) -> Answer | None:
        """Returns the nearest answer, with a bound of how near another might be.

        Args:
            masks: Sets of free observations, of which one set may move (m, k); all by default.

        Returns:
            The answer; None where none is possible.
        """
        if masks is None:
            masks = np.ones((1, self._target.size), dtype=bool)
        self._masks, self._batches = masks, _MOST_BATCHES + len(masks) // _BATCH
        self.reached, self._moves = self._descended() if masks.all() else (-np.inf, None)
        low, high = (np.where(masks[:, self._target.curved], end, 0.0) for end in self._ends)
        cells = Cells(low, high, np.zeros(len(masks)), np.arange(len(masks)))
        bound = greatest_bound(self, cells, at_once=_BATCH)
        if self._moves is None:
            return None
        found = moved(self._question, self._moves)
        return answered(self._question, found, float(np.sqrt(max(-bound, 0.0))))

    def fewest(self) -> Answer | None:
        """Returns the nearest answer that changes one observation, or else two; None if none."""
        least, greatest = self._target.slopes(*(end[None] for end in self._ends))
        used = np.flatnonzero((least[0] != 0) | (greatest[0] != 0))
        for count in (1, 2):
            chosen = np.array(list(combinations(used, count)), dtype=np.intp).reshape(-1, count)
            if not len(chosen):
                continue
            masks = np.zeros((len(chosen), self._target.size), dtype=bool)
            masks[np.arange(len(chosen))[:, None], chosen] = True
            found = self.nearest(masks)
            if found is not None:
                return found
        return None

    def reach(self) -> float:
        """Returns the greatest rise that is found (rad); of an affine target it is the greatest."""
        points = np.array(list(product(*np.linspace(*self._ends, _GRID).T)))
        slopes = self._target.gradient(points).copy()
        slopes[:, self._target.curved] = 0.0
        gains = np.maximum(slopes * self._up, slopes * self._down).sum(axis=1)
        return float((self._target.rise(points) + gains).max())

    def enough(self, greatest: float) -> float:
        """Of squared distances, whose negative is sought: what is no nearer, unless all is near."""
        near = -greatest * (1.0 + TOLERANCE) ** 2 >= -self.reached
        self._batches -= 1
        return np.inf if near or self._batches < 0 else self.reached

    def split(self, cells: Cells) -> tuple[Cells, float]:
        """Bounds the squared distance in boxes, seeks an answer in each, and halves them."""
        cells = self._clipped(cells)
        masks = self._masks[cells.label]
        bound, points = self._bounded(cells, masks)
        squared, moves = self._completed(points, masks)
        if len(squared) and -squared.min() > self.reached:
            self.reached, self._moves = -float(squared.min()), moves[squared.argmin()]
        if not len(self._target.curved):
            # Without any curve what was found is the nearest.
            return cells[np.zeros(len(cells), dtype=bool)], float((-squared).max(initial=-np.inf))
        return self._halved(Cells(cells.lower, cells.upper, -bound, cells.label)), -np.inf

    def _bounded(self, cells: Cells, masks: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Bounds the squared distance in boxes (m), and proposes a point in each (m, c)."""
        target, curved = self._target, self._target.curved
        low, high = cells.lower, cells.upper
        least, greatest = target.slopes(low, high)
        # The point of the box that is nearest, and how far it is from there to its sides.
        near = np.clip(0.0, low, high)
        down = np.where(masks, -self._down, 0.0)
        up = np.where(masks, self._up, 0.0)
        down[:, curved], up[:, curved] = near - low, high - near
        rising = np.where(up > 0, greatest, 0.0)
        falling = np.where(down > 0, -least, 0.0)
        gain = np.maximum(np.maximum(rising, falling), 0.0)
        side = np.maximum(np.where(rising > 0, up, 0.0), np.where(falling > 0, down, 0.0))
        start = np.zeros_like(gain)
        start[:, curved] = np.abs(near)
        need = self._question.need - target.rise(near) + (gain * start).sum(axis=1)
        most = np.minimum(start + side, np.sqrt(-self.reached))
        steps, bound = shortest_steps(gain, need, start, most)
        bound = np.maximum(np.maximum(bound, -cells.bound), (start * start).sum(axis=1))
        away = np.where(rising[:, curved] >= falling[:, curved], 1.0, -1.0)
        away = np.where(near == 0, away, np.sign(near))
        return bound, np.clip(away * steps[:, curved], low, high)

    def _completed(self, points: Array, masks: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Moves the others as little as will do, where the curved ones have moved (m, c).

        Returns:
            Squared distances (m), infinite where nothing will do, and the moves (m, k).
        """
        curved = self._target.curved
        slopes = np.where(masks, self._target.gradient(points), 0.0)
        slopes[:, curved] = 0.0
        most = np.where(slopes > 0, self._up, -self._down)
        need = self._question.need - self._target.rise(points)
        still = np.zeros_like(slopes)
        steps, squared = shortest_steps(np.abs(slopes), np.maximum(need, 0.0), still, most)
        moves = np.where(slopes == 0, 0.0, np.sign(slopes) * steps)
        moves[:, curved] = points
        squared = np.where(np.isfinite(squared), (moves * moves).sum(axis=1), np.inf)
        return squared, moves

    def _descended(self) -> tuple[float, Array | None]:
        """Finds a near answer by steps along the slopes: its negative squared distance, moves."""
        curved, masks = self._target.curved, np.ones((1, self._target.size), dtype=bool)
        point = np.zeros((1, len(curved)))
        best, moves = np.inf, None
        for _ in range(20 if len(curved) else 1):
            found, steps = self._completed(point, masks)
            if found[0] < best:
                best, moves = float(found[0]), steps[0]
            slopes = self._target.gradient(point)
            limits = np.where(slopes > 0, self._up, -self._down)
            passed = (slopes[:, curved] * point).sum(axis=1)
            need = self._question.need - self._target.rise(point) + passed
            steps, _ = shortest_steps(np.abs(slopes), need, np.zeros_like(slopes), limits)
            point = 0.5 * (point + np.clip((np.sign(slopes) * steps)[:, curved], *self._ends))
        return -best, moves

    def _clipped(self, cells: Cells) -> Cells:
        """Leaves out what is farther than an answer that there is."""
        farthest = np.sqrt(-self.reached)
        cells = cells[((cells.lower <= farthest) & (cells.upper >= -farthest)).all(axis=1)]
        lower, upper = np.maximum(cells.lower, -farthest), np.minimum(cells.upper, farthest)
        return Cells(lower, upper, cells.bound, cells.label)

    @cached_property
    def _weights(self) -> Array:
        """How much the slopes vary along each curved observation (c), a spread of it."""
        down, up = self._ends
        least, greatest = self._target.slopes(np.diag(down), np.diag(up))
        return np.linalg.norm(greatest - least, axis=1) / np.maximum(up - down, 1e-9) + 1e-12

    def _halved(self, cells: Cells) -> Cells:
        """Cuts every box in two where its slopes vary most, at what was observed if that is in."""
        row = np.arange(len(cells))
        side = np.argmax(self._weights * (cells.upper - cells.lower), axis=1)
        low, high = cells.lower[row, side], cells.upper[row, side]
        cut = np.where((low < 0) & (high > 0), 0.0, 0.5 * (low + high))
        below, above = cells.upper.copy(), cells.lower.copy()
        below[row, side] = above[row, side] = cut
        lower, upper = (cells.lower, above), (below, cells.upper)
        halves = [Cells(*ends, cells.bound, cells.label) for ends in zip(lower, upper, strict=True)]
        return halves[0].joined(halves[1])


_HALVINGS = 45
"""Halvings of the multiplier's interval, down to rounding errors."""


def shortest_steps(gain: Array, need: Array, least: Array, most: Array) -> tuple[Array, Array]:
    """Minimizes Σ w² where Σ gain · w is `need` or more, and every w within its limits.

    Every w is least ≤ multiplier · gain ≤ most, cut at its limits; one multiplier serves a row.

    Args:
        gain: What a unit of each step gains (m, n), 0 or more.
        need: What must be gained (m).
        least: Least steps (m, n), 0 or more.
        most: Greatest steps (m, n).

    Returns:
        The steps (m, n), and a bound (m) that the minimum is not below: the minimum itself but for
        rounding errors, infinite where the limits allow no such steps.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = np.where(gain > 0, most / gain, 0.0)
    low, high = np.zeros(len(need)), needed.max(axis=1, initial=0.0)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        enough = _total(gain, _cut(middle, gain, least, most)) >= need
        high, low = np.where(enough, middle, high), np.where(enough, low, middle)
    steps = _cut(high, gain, least, most)
    missing = need - _total(gain, steps)
    # Any multiplier bounds the minimum from below, by Lagrange's dual.
    bound = (steps * steps).sum(axis=1) + 2.0 * high * missing
    possible = missing <= 1e-12 * (1.0 + np.abs(need))
    return steps, np.where(possible, bound, np.inf)


def _cut(multiplier: Array, gain: Array, least: Array, most: Array) -> Array:
    return np.clip(multiplier[:, None] * gain, least, most)


def _total(gain: Array, steps: Array) -> Array:
    return np.einsum("ij,ij->i", gain, steps)
