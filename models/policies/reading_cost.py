"""The cost of reading a policy: two numbers, counted alike for every kind.

They leave out what all policies share: units of the observation, odometry, reward machine, limits.

- `operations`: multiplications, additions, comparisons and calls of functions of a control step,
  divided by the twelve joints. A definition counts once. Where each RM state has its formulas or
  weights, one state acts; states are averaged.
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
    """Counts operations per action and numbers to read; NaN for a function of Python."""
    return ReadingCost(np.nan, np.nan)


@reading_cost.register
def _(policy: LinearPolicy) -> ReadingCost:
    # A product an observation, and as many additions, the intercept's included.
    return ReadingCost(2 * policy.weights.shape[-1], policy.weights.size + policy.intercepts.size)


@reading_cost.register
def _(policy: BoostedTreesPolicy) -> ReadingCost:
    # A comparison a level, and an addition a tree. Early ends of branches hold no threshold.
    n_trees, thresholds = policy.features.shape[1], np.isfinite(policy.thresholds).sum()
    leaves = thresholds + N_JOINTS * n_trees
    return ReadingCost(n_trees * (policy.depth + 1), int(thresholds + leaves + N_JOINTS))


@reading_cost.register
def _(policy: AdditivePolicy) -> ReadingCost:
    # Bins are searched by halving, once for all joints; each function is then an addition.
    fine, coarse = (np.isfinite(cuts).sum(axis=1) for cuts in (policy.cuts, policy.pair_cuts))
    coarse[np.isin(np.arange(len(coarse)), policy.pairs, invert=True)] = 0
    comparisons = np.ceil(np.log2(np.concatenate([fine, coarse]) + 1)).sum()
    additions = N_JOINTS * len(fine) + len(policy.pairs)
    values = N_JOINTS * (fine + 1).sum() + (coarse[policy.pairs] + 1).prod(axis=1).sum()
    numbers = values + fine.sum() + coarse.sum() + N_JOINTS
    return ReadingCost(round(float(comparisons + additions) / N_JOINTS), int(numbers))


@reading_cost.register
def _(policy: NeuralPolicy) -> ReadingCost:
    # A product and an addition a weight, bias included, and a function a hidden unit.
    actor = policy.actor
    weights, units = sum(one.size for one in actor.weights), sum(map(len, actor.biases))
    operations = 2 * weights + units - N_JOINTS
    if actor.reflections is not None:
        # Twice, for the robot and for its mirror image, and the mean of both.
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
    defined = enumerate(policy.vocabulary.definitions, start=len(policy.observation_names))
    return [definition.formula for index, definition in defined if index in used]


def _n_operations(formula: Expression) -> int:
    own = formula.operator not in ("constant", "variable")
    return own + sum(map(_n_operations, formula.operands))
