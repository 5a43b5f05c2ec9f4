"""Sparse gated sums: formulas that least squares finds, for evolution to start from.

A gated sum is A + g·B + h·C + …, where A, B, C are weighted sums of few observations and the gates
g, h, … are states of the reward machine. The iterations in a state are no gate: where a robot is
late, their products would grow without bound.
"""

import warnings
from collections.abc import Sequence

import numpy as np
from sklearn.linear_model import orthogonal_mp_gram

from models.a1.robot import Array
from models.policies.expression import Expression
from models.task.observation import machine_state_entries

PENALTY = 0.003
"""Ridge penalty on the weights of standardised observations, for each sample.

Joints move together, and without a penalty their weights grow against one another: of equal R²,
formulas of a trot then fell in 3 of 52 rollouts instead of none.
"""


def fit_gated_sum(
    observations: Array, target: Array, gates: Sequence[int], max_length: int
) -> Expression:
    """Fits the longest gated sum of at most `max_length` nodes, by orthogonal matching pursuit
    with a ridge penalty.

    Args:
        observations: Samples (m, n).
        target: What to fit (m,).
        gates: Observations that gate, states of the machine; none for a plain weighted sum.
        max_length: Bound on `Expression.length`.
    """
    columns = [observations, *(observations * observations[:, [gate]] for gate in gates)]
    candidates = np.concatenate(columns, axis=1)
    mean, spread = candidates.mean(axis=0), candidates.std(axis=0)
    # A product of a state with itself is the state again: of equal columns the first is enough.
    _, first = np.unique(candidates, axis=1, return_index=True)
    usable = np.sort(first[spread[first] > 1e-12])
    standard = (candidates[:, usable] - mean[usable]) / spread[usable]
    penalty = PENALTY * len(target) * np.eye(len(usable))
    gram, product = standard.T @ standard + penalty, standard.T @ (target - target.mean())

    n = observations.shape[1]
    formula = Expression("constant", value=float(target.mean()))
    for count in range(1, min(len(usable), max_length // 2) + 1):
        weights = np.zeros(len(mean))
        with warnings.catch_warnings():
            # Where fewer terms fit exactly, fewer are found.
            warnings.filterwarnings("ignore", "Orthogonal matching pursuit ended prematurely")
            found = orthogonal_mp_gram(gram, product, n_nonzero_coefs=count)
        weights[usable] = found / spread[usable]
        larger = _gated_expression(gates, weights.reshape(-1, n), target.mean() - weights @ mean)
        if larger.length > max_length:
            break
        formula = larger
    return formula


def machine_gates(names: tuple[str, ...]) -> tuple[int, ...]:
    """Finds the observations that gate: the machine's states but the last.

    The last state is where all others are 0.
    """
    states = machine_state_entries(names)
    return tuple(range(states.start, states.stop - 1))


def scaled(expression: Expression, factor: float) -> Expression:
    """Multiplies a formula by a number."""
    return Expression("mul", (Expression("constant", value=factor), expression))


def _gated_expression(gates: Sequence[int], weights: Array, intercept: float) -> Expression:
    total = Expression("constant", value=float(intercept))
    for gate, row in zip((None, *gates), weights, strict=True):
        terms = [scaled(_variable(i), float(row[i])) for i in np.flatnonzero(row)]
        if not terms:
            continue
        part = terms[0]
        for term in terms[1:]:
            part = Expression("add", (part, term))
        if gate is not None:
            part = Expression("mul", (_variable(gate), part))
        total = Expression("add", (total, part))
    return total


def _variable(index: int) -> Expression:
    return Expression("variable", variable=int(index))
