"""Sparse gated sums: formulas that least squares finds, for evolution to start from.

A gated sum is A + g·B + h·C + …, where A, B, C are weighted sums of few observations and the gates
g, h, … encode where in the gait the robot is.
"""

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from itertools import takewhile

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.formulas.evaluate import Tape
from glassgait.models.formulas.expression import Expression, constant, plus, scaled, variable

SPREAD = 1e-12
"""Least standard deviation of a term."""

EQUAL = 1e-9
"""Two terms are equal if their correlation differs from 1 or -1 by less."""

PENALTY = 0.003
"""Ridge penalty on the weights of standardised observations, for each sample.

Joints move together, and without a penalty their weights grow against one another: of equal R²,
formulas of a trot then fell in 3 of 52 rollouts instead of none.
"""

BLOCK = 16_384
"""Samples whose possible terms are in memory at once."""


@dataclass(frozen=True)
class PossibleTerms:
    """The possible terms of a gated sum: each quantity, and its product with each gate.

    They are those of quantities (m, n) and the gates opened there (m, g). Blocks of samples are
    made as they are read: all terms of 300,000 samples take 4 GB.
    """

    values: Array
    opened: Array

    def blocks(self) -> Iterator[tuple[slice, Array]]:
        """Yields which samples, and their terms (b, n (g + 1)): by gate, without one first."""
        for start in range(0, len(self.values), BLOCK):
            rows = slice(start, start + BLOCK)
            values, opened = self.values[rows], self.opened[rows].T
            yield rows, np.hstack([values, *(values * gate[:, None] for gate in opened)])

    @cached_property
    def moments(self) -> tuple[Array, Array]:
        """Mean and standard deviation of each term."""
        nothing = np.zeros(self.values.shape[1] * (1 + self.opened.shape[1]))
        mean = sum((block.sum(axis=0) for _, block in self.blocks()), nothing) / len(self.values)
        squares = (((block - mean) ** 2).sum(axis=0) for _, block in self.blocks())
        return mean, np.sqrt(sum(squares, nothing) / len(self.values))


def fit_gated_sums(
    values: Array,
    targets: Array,
    gates: Sequence[Expression],
    max_length: int,
    weighted: int | None = None,
) -> list[Expression]:
    """Fits the longest gated sums of at most `max_length` nodes to targets (m, j).

    Sums hold the first `weighted` variables of the values (m, k), or all; gates may hold any.
    """
    # A term takes two nodes at least, so that no longer path is needed.
    n = values.shape[1] if weighted is None else weighted
    terms = PossibleTerms(values[:, :n], Tape(gates, values.shape[1])(values))
    mean, target_means = terms.moments[0], targets.mean(axis=0)
    formulas = []
    for target_mean, path in zip(
        target_means, weight_paths(terms, targets, max_length // 2), strict=True
    ):
        sums = (
            gated_expression(gates, weights.reshape(-1, n), target_mean - weights @ mean)
            for weights in path
        )
        *_, longest = takewhile(lambda formula: formula.length <= max_length, sums)
        formulas.append(longest)
    return formulas


def weight_paths(terms: PossibleTerms, targets: Array, max_terms: int) -> list[Array]:
    """Chooses terms for targets (m, j) by orthogonal matching pursuit with a ridge penalty.

    Returns weights (terms + 1, k) for each target, before the first term and after each.
    """
    # Standardise the terms, and accumulate their products block by block.
    mean, spread = terms.moments
    usable = np.flatnonzero(spread > SPREAD)
    gram = np.zeros((len(usable), len(usable)))
    products = np.zeros((len(usable), targets.shape[1]))
    centred = targets - targets.mean(axis=0)
    for rows, block in terms.blocks():
        standard = (block[:, usable] - mean[usable]) / spread[usable]
        gram += standard.T @ standard
        products += standard.T @ centred[rows]

    # A product of a state with itself is the state again: of equal terms the first is enough.
    known = np.triu(np.abs(gram) > (1.0 - EQUAL) * len(targets), k=1).any(axis=0)
    usable, products, gram = usable[~known], products[~known], gram[np.ix_(~known, ~known)]
    gram += PENALTY * len(targets) * np.eye(len(usable))

    # Pursue each target, in the scale of the terms.
    paths = []
    for product in products.T:
        found = _pursue(gram, product, max_terms)
        path = np.zeros((len(found), len(mean)))
        path[:, usable] = found / spread[usable]
        paths.append(path)
    return paths


def _pursue(gram: Array, product: Array, max_terms: int) -> Array:
    """Returns the weights before the first term and after each (terms + 1, candidates)."""
    from sklearn.linear_model import orthogonal_mp_gram

    none, count = np.zeros((1, len(gram))), min(len(gram), max_terms)
    if count == 0:
        return none
    with warnings.catch_warnings():
        # Where fewer terms fit exactly, fewer are found.
        warnings.filterwarnings("ignore", "Orthogonal matching pursuit ended prematurely")
        path = orthogonal_mp_gram(gram, product, n_nonzero_coefs=count, return_path=True)
    return np.concatenate([none, np.asarray(path).reshape(len(gram), -1).T])


def gated_expression(gates: Sequence[Expression], weights: Array, intercept: float) -> Expression:
    """Writes a gated sum by its weights (g + 1, n): those that count always, then by gate."""
    total = constant(float(intercept))
    for gate, row in zip((None, *gates), weights, strict=True):
        columns = np.flatnonzero(row).tolist()
        parts = [scaled(variable(i), float(row[i])) for i in columns]
        if gate is not None and len(parts) == 1:
            # A single weight stands before the gate.
            (i,) = columns
            parts = [Expression("mul", (scaled(gate, float(row[i])), variable(i)))]
        elif gate is not None and parts:
            parts = [Expression("mul", (gate, reduce(plus, parts)))]
        for part in parts:
            total = Expression("add", (total, part))
    return total
