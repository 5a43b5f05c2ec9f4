"""The nearest choice of a leaf in every tree, by mixed-integer programming."""

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.counterfactuals.forest import Leaves
from glassgait.models.counterfactuals.program import SLACK, Program


def nearest_leaves(leaves: Leaves, need: float, farthest: float) -> tuple[Array | None, float]:
    """Chooses a leaf in every tree so that they add up to enough and agree with one another.

    A cut that an observation goes past is a variable of 0 or 1. A leaf needs the cuts that it lies
    beyond to be passed, and those that it lies before not to be. Leaves need not be told to be
    whole, for where the cuts are, they are.

    Args:
        leaves: Those that are no farther than an answer that there is.
        need: What they must add up to (rad).
        farthest: Squared distance of that answer, infinite without one.

    Returns:
        The cut up to which each free observation moves (k; spreads), 0 where it stays, if a choice
        was found, and a bound of the squared distance.
    """
    if not len(leaves.trees):
        return None, farthest
    program = Program()
    _, trees = np.unique(leaves.trees, return_inverse=True)
    chosen = program.add_variables(np.zeros(len(trees)), whole=False)
    program.add_rows(int(trees.max()) + 1, [(trees, chosen, 1.0)], (1.0, 1.0))
    every = np.zeros(len(chosen), dtype=np.intp)
    program.add_rows(1, [(every, chosen, leaves.values)], (need + SLACK, np.inf))
    sides = []
    for place, (low, high) in enumerate(zip(leaves.low.T, leaves.high.T, strict=True)):
        up = _add_side(program, trees, chosen, low, high, np.sqrt(farthest))
        # Where an observation goes down, all is as where it goes up, mirrored.
        down = _add_side(program, trees, chosen, -high, -low, np.sqrt(farthest))
        sides += [(place, 1.0, *up), (place, -1.0, *down)]
        either = np.concatenate([numbers[:1] for _, numbers in (up, down)])
        program.add_rows(1, [(np.zeros_like(either), either, 1.0)], (0.0, 1.0))
    solution, bound = program.solve(farthest)
    if solution is None:
        return None, bound
    moves = np.zeros(leaves.low.shape[1])
    for place, sign, cuts, numbers in sides:
        passed = cuts[solution[numbers] > 0.5]
        if len(passed):
            moves[place] = sign * passed[-1]
    return moves, bound


def _add_side(
    program: Program,
    trees: NDArray[np.intp],
    chosen: NDArray[np.intp],
    low: Array,
    high: Array,
    farthest: float,
) -> tuple[Array, NDArray[np.intp]]:
    """Adds the cuts that one observation may pass, going one way.

    Args:
        program: What they are added to.
        trees: Tree of each leaf (m).
        chosen: Number of each leaf's variable (m).
        low: Where each leaf begins (m; spreads).
        high: Where it ends (m).
        farthest: How far the observation may go.

    Returns:
        The cuts, from near to far, and the numbers of their variables.
    """
    ends = np.unique(np.concatenate([low, high]))
    cuts = ends[(ends >= 0) & (ends < min(farthest, high.max()))]
    # Each pays for the way from the cut before.
    numbers = program.add_variables(np.diff(cuts * cuts, prepend=0.0), whole=True)
    rows = np.arange(max(len(cuts) - 1, 0))
    order = [(rows, numbers[:-1], 1.0), (rows, numbers[1:], -1.0)]
    program.add_rows(len(rows), order, (0.0, 1.0))
    # The last cut that a leaf lies beyond, and the first that it lies before.
    beyond = np.searchsorted(cuts, low, side="right") - 1
    before = np.searchsorted(cuts, high, side="left")
    for index, within, sign, limits in (
        (beyond, beyond >= 0, -1.0, (-1.0, 0.0)),
        (before, (before < len(cuts)) & (high >= 0), 1.0, (0.0, 1.0)),
    ):
        asked = np.unique(np.stack([trees[within], index[within]]), axis=1)
        tree, cut = asked[:, :, None]
        farther = index >= cut if sign < 0 else index <= cut
        row, leaf = np.nonzero((trees == tree) & farther & within)
        rows = np.arange(asked.shape[1])
        entries = [(row, chosen[leaf], 1.0), (rows, numbers[asked[1]], sign)]
        program.add_rows(len(rows), entries, limits)
    return cuts, numbers
