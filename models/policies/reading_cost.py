"""The cost of reading a policy: two numbers, counted in the same way for every kind.

They leave out what all policies share: units of the observation, odometry, reward machine, limits.

- `operations`: multiplications, additions, comparisons and function calls per control step,
  divided by the twelve joints. A definition counts once. Formulas of different RM states are
  averaged, since only one state is active.
- `numbers`: the numeric parameters that decide what the policy does. Mirror images that its file
  leaves out do not count.
"""

from collections.abc import Iterable
from functools import singledispatch
from itertools import chain
from typing import NamedTuple

import numpy as np

from glassgait.models.formulas.expression import Expression, numbers_of
from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.policies.linear import LinearPolicy
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots.quadruped import N_JOINTS

READING_COST_TITLES = ("operations per action", "numbers to read")
"""Titles of the two numbers in tables."""


class ReadingCost(NamedTuple):
    operations: float
    numbers: float


@singledispatch
def reading_cost(policy: Policy) -> ReadingCost:
    """Counts operations per action and numbers to read; NaN for a function and an ONNX network."""
    return ReadingCost(np.nan, np.nan)


@reading_cost.register
def _(policy: LinearPolicy) -> ReadingCost:
    # One product per observation, and as many additions, counting that of the intercept.
    return ReadingCost(2 * policy.weights.shape[-1], policy.weights.size + policy.intercepts.size)


@reading_cost.register
def _(policy: BoostedTreesPolicy) -> ReadingCost:
    # One comparison per level and one addition per tree. Nodes below early leaves do not count.
    n_trees, thresholds = policy.features.shape[1], np.isfinite(policy.thresholds).sum()
    leaves = thresholds + N_JOINTS * n_trees
    return ReadingCost(n_trees * (policy.depth + 1), int(thresholds + leaves + N_JOINTS))


@reading_cost.register
def _(policy: AdditivePolicy) -> ReadingCost:
    # A binary search finds each bin, once for all joints; each function then needs one addition.
    fine, coarse = (np.isfinite(cuts).sum(axis=1) for cuts in (policy.cuts, policy.pair_cuts))
    coarse[np.isin(np.arange(len(coarse)), policy.pairs, invert=True)] = 0
    comparisons = np.ceil(np.log2(np.concatenate([fine, coarse]) + 1)).sum()
    additions = N_JOINTS * len(fine) + len(policy.pairs)
    values = N_JOINTS * (fine + 1).sum() + (coarse[policy.pairs] + 1).prod(axis=1).sum()
    numbers = values + fine.sum() + coarse.sum() + N_JOINTS
    return ReadingCost(round(float(comparisons + additions) / N_JOINTS), int(numbers))


@reading_cost.register
def _(policy: NeuralPolicy) -> ReadingCost:
    # One product and one addition per weight, bias included, and one function per hidden unit.
    actor = policy.actor
    weights, units = sum(layer.size for layer in actor.weights), sum(map(len, actor.biases))
    operations = 2 * weights + units - N_JOINTS
    if actor.reflections is not None:
        # The network runs for the robot and for its mirror image, and the outputs are averaged.
        operations = 2 * operations + 2 * N_JOINTS
    return ReadingCost(round(operations / N_JOINTS), weights + units)


@reading_cost.register
def _(policy: FormulaPolicy) -> ReadingCost:
    operations = [
        sum(map(_n_operations, chain(row, _definitions(policy, row))))
        for row in policy.formulas_by_state
    ]
    written = list(policy.to_file().written().values())
    numbers = chain(*map(numbers_of, chain(written, _definitions(policy, written))))
    return ReadingCost(round(float(np.mean(operations)) / N_JOINTS), len([*numbers]))


def _definitions(policy: FormulaPolicy, formulas: Iterable[Expression]) -> list[Expression]:
    """Returns the formulas of the definitions that formulas use."""
    used = frozenset().union(*(formula.variables for formula in formulas))
    numbered = enumerate(policy.vocabulary.definitions, start=len(policy.observation_names))
    return [definition.formula for index, definition in numbered if index in used]


def _n_operations(formula: Expression) -> int:
    is_operation = formula.operator not in ("constant", "variable")
    return is_operation + sum(map(_n_operations, formula.operands))
