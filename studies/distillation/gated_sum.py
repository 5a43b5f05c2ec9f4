"""Sparse gated sums: formulas that least squares finds, for evolution to start from.

A gated sum is A + g·B + h·C + …, where A, B, C are weighted sums of few observations. The gates g,
h, … tell where in the gait the robot is: states of the reward machine, whether it is early or late
in a state, and which feet are in the air. All are bounded; a product with the iterations themselves
would grow without bound where the robot is late.
"""

import warnings
from collections.abc import Sequence

import numpy as np
from sklearn.linear_model import orthogonal_mp_gram

from models.a1.robot import Array
from models.policies.expression import Expression
from models.policies.symbolic import Tape
from models.task.observation import ITERATIONS_SCALE, machine_state_entries

SPREAD = 1e-12
"""A term of a smaller standard deviation says nothing."""

EQUAL = 1e-9
"""Two terms are equal whose correlation differs from 1 or -1 by less."""

PENALTY = 0.003
"""Ridge penalty on the weights of standardised observations, for each sample.

Joints move together, and without a penalty their weights grow against one another: of equal R²,
formulas of a trot then fell in 3 of 52 rollouts instead of none.
"""

LATE = 4
"""Control steps in a state of the machine that are neither early nor late."""

LIFTED = 0.02
"""Height of a foot that is neither on the ground nor in the air (m)."""


def fit_gated_sums(
    observations: Array, targets: Array, gates: Sequence[Expression], max_length: int
) -> list[Expression]:
    """Fits the longest gated sums of at most `max_length` nodes, by orthogonal matching pursuit
    with a ridge penalty.

    Args:
        observations: Samples (m, n).
        targets: What to fit (m, k), a formula a column.
        gates: Bounded functions of the observations; none for a plain weighted sum.
        max_length: Bound on `Expression.length`.

    Returns:
        The k formulas.
    """
    n = observations.shape[1]
    opened = Tape(gates, n)(observations)
    candidates = np.concatenate(
        [observations, *(observations * gate[:, None] for gate in opened.T)], axis=1
    )
    mean, spread = candidates.mean(axis=0), candidates.std(axis=0)
    usable = np.flatnonzero(spread > SPREAD)
    standard = (candidates[:, usable] - mean[usable]) / spread[usable]
    gram = standard.T @ standard
    # A product of a state with itself is the state again: of equal terms the first is enough.
    known = np.triu(np.abs(gram) > (1.0 - EQUAL) * len(targets), k=1).any(axis=0)
    usable, standard, gram = usable[~known], standard[:, ~known], gram[np.ix_(~known, ~known)]
    gram += PENALTY * len(targets) * np.eye(len(usable))
    intercepts = targets.mean(axis=0)
    products = standard.T @ (targets - intercepts)

    formulas = []
    for intercept, product in zip(intercepts, products.T, strict=True):
        formula = Expression("constant", value=float(intercept))
        for found in _pursue(gram, product, max_length // 2):
            weights = np.zeros(len(mean))
            weights[usable] = found / spread[usable]
            larger = _gated_expression(gates, weights.reshape(-1, n), intercept - weights @ mean)
            if larger.length > max_length:
                break
            formula = larger
        formulas.append(formula)
    return formulas


def _pursue(gram: Array, product: Array, max_terms: int) -> Array:
    """Returns the weights after each term (terms, candidates)."""
    count = min(len(gram), max_terms)
    if count == 0:
        return np.zeros((0, len(gram)))
    with warnings.catch_warnings():
        # Where fewer terms fit exactly, fewer are found.
        warnings.filterwarnings("ignore", "Orthogonal matching pursuit ended prematurely")
        path = orthogonal_mp_gram(gram, product, n_nonzero_coefs=count, return_path=True)
    return np.asarray(path).reshape(len(gram), -1).T


def machine_gates(names: tuple[str, ...]) -> tuple[Expression, ...]:
    """Returns the states of the machine but the last, which is where all others are 0."""
    states = machine_state_entries(names)
    return tuple(_variable(index) for index in range(states.start, states.stop - 1))


def lateness_gate(names: tuple[str, ...]) -> Expression:
    """Returns a function that goes from -1 early in a state of the machine to 1 late in it.

    It is tanh((n - 4) / 2) of the n control steps spent there. A steeper and earlier one,
    tanh(n - 2), imitates better and walks no better.
    """
    return _turning(_variable(names.index("RM Iters")), LATE * ITERATIONS_SCALE, 5.0)


def foot_gates(names: tuple[str, ...]) -> tuple[Expression, ...]:
    """Returns for each foot a function that goes from -1 on the ground to 1 in the air."""
    feet = [index for index, name in enumerate(names) if name.startswith("Foot Height")]
    return tuple(_turning(_variable(foot), LIFTED, 100.0) for foot in feet)


def scaled(expression: Expression, factor: float) -> Expression:
    """Multiplies a formula by a number."""
    return Expression("mul", (Expression("constant", value=factor), expression))


def _turning(expression: Expression, where: float, slope: float) -> Expression:
    offset = Expression("constant", value=-slope * where)
    return Expression("tanh", (Expression("add", (scaled(expression, slope), offset)),))


def _gated_expression(gates: Sequence[Expression], weights: Array, intercept: float) -> Expression:
    total = Expression("constant", value=float(intercept))
    for gate, row in zip((None, *gates), weights, strict=True):
        terms = [scaled(_variable(i), float(row[i])) for i in np.flatnonzero(row)]
        if not terms:
            continue
        part = terms[0]
        for term in terms[1:]:
            part = Expression("add", (part, term))
        if gate is not None:
            part = Expression("mul", (gate, part))
        total = Expression("add", (total, part))
    return total


def _variable(index: int) -> Expression:
    return Expression("variable", variable=int(index))
