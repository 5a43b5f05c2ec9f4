"""The nearest answer on a smooth target, by branch and bound over its curved observations."""

from dataclasses import dataclass, replace
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.counterfactuals.question import TOLERANCE, Answer, Question, answered, moved
from glassgait.models.counterfactuals.smooth import AffineTarget, FormulaTarget, SmoothTarget

_BATCH = 128
"""Boxes that are bounded at once."""

_MOST_BATCHES = 300
"""Batches after which the search ends with the gap that it then has."""

_GRID = 4
"""Points of each curved observation where the most that can be reached is looked for."""


@dataclass(frozen=True)
class _Boxes:
    """Boxes of the curved observations.

    Attributes:
        masks: Which free observations may move (m, k).
        low: Least moves of the curved ones (m, c).
        high: Greatest moves (m, c).
        bound: What the squared distance is at least (m).
    """

    masks: NDArray[np.bool_]
    low: Array
    high: Array
    bound: Array

    def __len__(self) -> int:
        return len(self.bound)

    def __getitem__(self, which: NDArray[np.bool_] | NDArray[np.intp] | slice) -> "_Boxes":
        return _Boxes(self.masks[which], self.low[which], self.high[which], self.bound[which])

    def join(self, other: "_Boxes") -> "_Boxes":
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return _Boxes(*(np.concatenate(pair) for pair in pairs))


class SmoothSearch:
    """Looks for the nearest answer among those that move no more than some observations."""

    def __init__(self, question: Question, target: SmoothTarget) -> None:
        """
        Args:
            question: The question.
            target: The target that it asks for.
        """
        self._question = question
        self._target = target
        self._down, self._up = question.room.limits(question.observation)

    @classmethod
    def of_linear(cls, question: Question) -> "SmoothSearch":
        """Searches a linear law."""
        return cls(question, AffineTarget(question))

    @classmethod
    def of_formula(cls, question: Question) -> "SmoothSearch":
        """Searches a formula."""
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
        curved = self._target.curved
        low, high = (np.where(masks[:, curved], e[curved], 0.0) for e in (self._down, self._up))
        waiting = _Boxes(masks, low, high, np.zeros(len(masks)))
        best, moves = self._descended() if masks.all() else (np.inf, None)
        weights, bound = None, 0.0
        for _ in range(_MOST_BATCHES + len(masks) // _BATCH):
            if not len(waiting):
                bound = best
                break
            bound = min(best, float(waiting.bound.min()))
            if best <= (1.0 + TOLERANCE) ** 2 * bound:
                break
            chosen = np.argsort(waiting.bound, kind="stable")[:_BATCH]
            boxes, waiting = waiting[chosen], waiting[np.setdiff1d(np.arange(len(waiting)), chosen)]
            boxes = self._clipped(boxes, best)
            boxes, found, steps = self._bounded(boxes, best)
            if len(found) and found.min() < best:
                best, moves = float(found.min()), steps[found.argmin()]
            if weights is None:
                weights = self._weights()
            boxes = boxes[boxes.bound < best]
            waiting = waiting[waiting.bound < best].join(self._halved(boxes, weights))
        if moves is None:
            return None
        return answered(self._question, moved(self._question, moves), float(np.sqrt(bound)))

    def fewest(self) -> Answer | None:
        """Returns the nearest answer that changes one observation, or else two; None if none."""
        ends = (self._down[self._target.curved], self._up[self._target.curved])
        least, greatest = self._target.slopes(*(end[None] for end in ends))
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
        curved = self._target.curved
        ends = np.linspace(self._down[curved], self._up[curved], _GRID).T
        points = np.array(list(product(*ends)))
        slopes, _ = self._target.slopes(points, points)
        slopes = slopes.copy()
        slopes[:, curved] = 0.0
        gains = np.maximum(slopes * self._up, slopes * self._down).sum(axis=1)
        return float((self._target.rise(points) + gains).max())

    def _bounded(self, boxes: _Boxes, best: float) -> tuple[_Boxes, Array, Array]:
        """Bounds the squared distance in boxes, and finds an answer in each that has one.

        Returns:
            The boxes with their bounds, squared distances of answers (m) and their moves (m, k).
        """
        target, curved = self._target, self._target.curved
        least, greatest = target.slopes(boxes.low, boxes.high)
        # The point of the box that is nearest, and how far it is from there to its sides.
        near = np.clip(0.0, boxes.low, boxes.high)
        down = np.where(boxes.masks, -self._down, 0.0)
        up = np.where(boxes.masks, self._up, 0.0)
        down[:, curved], up[:, curved] = near - boxes.low, boxes.high - near
        rising = np.where(up > 0, greatest, 0.0)
        falling = np.where(down > 0, -least, 0.0)
        gain = np.maximum(np.maximum(rising, falling), 0.0)
        side = np.maximum(np.where(rising > 0, up, 0.0), np.where(falling > 0, down, 0.0))
        start = np.zeros_like(gain)
        start[:, curved] = np.abs(near)
        need = self._question.need - target.rise(near) + (gain * start).sum(axis=1)
        steps, bound = shortest_steps(gain, need, start, np.minimum(start + side, np.sqrt(best)))
        bound = np.maximum(np.maximum(bound, boxes.bound), (start * start).sum(axis=1))
        away = np.where(rising[:, curved] >= falling[:, curved], 1.0, -1.0)
        away = np.where(near == 0, away, np.sign(near))
        points = np.clip(away * steps[:, curved], boxes.low, boxes.high)
        found, moves = self._completed(points, boxes.masks)
        if not len(curved):
            # Without any curve the bound is met.
            bound, boxes = found, replace(boxes, bound=found)
        return replace(boxes, bound=bound), found, moves

    def _completed(self, points: Array, masks: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Moves the others as little as will do, where the curved ones have moved (m, c)."""
        curved = self._target.curved
        slopes, _ = self._target.slopes(points, points)
        slopes = np.where(masks, slopes, 0.0)
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
        """Finds a near answer by steps along the slopes."""
        curved, masks = self._target.curved, np.ones((1, self._target.size), dtype=bool)
        point = np.zeros((1, len(curved)))
        best, moves = np.inf, None
        for _ in range(20 if len(curved) else 1):
            found, steps = self._completed(point, masks)
            if found[0] < best:
                best, moves = float(found[0]), steps[0]
            slopes, _ = self._target.slopes(point, point)
            limits = np.where(slopes > 0, self._up, -self._down)
            passed = (slopes[:, curved] * point).sum(axis=1)
            need = self._question.need - self._target.rise(point) + passed
            steps, _ = shortest_steps(np.abs(slopes), need, np.zeros_like(slopes), limits)
            there = np.clip(
                (np.sign(slopes) * steps)[:, curved], self._down[curved], self._up[curved]
            )
            point = 0.5 * (point + there)
        return best, moves

    def _clipped(self, boxes: _Boxes, best: float) -> _Boxes:
        """Leaves out what is farther than an answer that there is."""
        farthest = np.sqrt(best)
        boxes = boxes[((boxes.low <= farthest) & (boxes.high >= -farthest)).all(axis=1)]
        low, high = np.maximum(boxes.low, -farthest), np.minimum(boxes.high, farthest)
        return replace(boxes, low=low, high=high)

    def _weights(self) -> Array:
        """Returns how much the slopes vary along each curved observation (c), a spread of it."""
        curved = self._target.curved
        n = len(curved)
        low, high = np.diag(self._down[curved]), np.diag(self._up[curved])
        least, greatest = self._target.slopes(low, high)
        width = np.maximum(self._up[curved] - self._down[curved], 1e-9)
        return np.linalg.norm(greatest - least, axis=1)[:n] / width + 1e-12

    def _halved(self, boxes: _Boxes, weights: Array) -> _Boxes:
        """Cuts every box in two where its slopes vary most, at what was observed if that is in."""
        if not len(self._target.curved) or not len(boxes):
            return boxes[:0]
        row = np.arange(len(boxes))
        side = np.argmax(weights * (boxes.high - boxes.low), axis=1)
        low, high = boxes.low[row, side], boxes.high[row, side]
        cut = np.where((low < 0) & (high > 0), 0.0, 0.5 * (low + high))
        below, above = boxes.high.copy(), boxes.low.copy()
        below[row, side] = above[row, side] = cut
        return replace(boxes, high=below).join(replace(boxes, low=above))


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
