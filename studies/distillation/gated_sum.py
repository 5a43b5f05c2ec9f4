"""Sparse gated sums: formulas fitted by least squares, from which an evolutionary search starts.

A gated sum is A + g·B + h·C + …, where A, B, C are weighted sums of few observations, and the gates
g, h, … are formulas of the robot's place in the gait and its motion.
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

SPREAD = 1e-12  # terms of a smaller standard deviation are not used
EQUAL = 1e-9  # two terms count as equal if their correlation differs from 1 or -1 by less

PENALTY = 0.003
"""Ridge penalty per sample on the weights of standardised observations.

Joint angles are correlated, and without a penalty their weights grow with opposite signs. At equal
R², formulas of a trot then fell in 3 of 52 rollouts instead of none.
"""

BLOCK = 16_384  # number of samples whose possible terms are in memory at once


@dataclass(frozen=True)
class PossibleTerms:
    """The possible terms of a gated sum: each quantity (m, n), and its product with each gate.

    Gates have values (m, g). Terms are computed in blocks, since those of 300,000 samples take
    4 GB.
    """

    values: Array
    gates: Array

    def blocks(self) -> Iterator[tuple[slice, Array]]:
        """Yields slices of samples and their terms (b, n (g + 1)): without gate, then by gate."""
        for start in range(0, len(self.values), BLOCK):
            rows = slice(start, start + BLOCK)
            values, gates = self.values[rows], self.gates[rows].T
            yield rows, np.hstack([values, *(values * gate[:, None] for gate in gates)])

    @cached_property
    def moments(self) -> tuple[Array, Array]:
        """Mean and standard deviation of each term."""
        zeros = np.zeros(self.values.shape[1] * (1 + self.gates.shape[1]))
        mean = sum((block.sum(axis=0) for _, block in self.blocks()), zeros) / len(self.values)
        squares = (((block - mean) ** 2).sum(axis=0) for _, block in self.blocks())
        return mean, np.sqrt(sum(squares, zeros) / len(self.values))


def fit_gated_sums(
    values: Array,
    targets: Array,
    gates: Sequence[Expression],
    max_length: int,
    weighted: int | None = None,
) -> list[Expression]:
    """Fits the longest gated sums of at most `max_length` nodes to targets (m, j).

    Sums use the first `weighted` variables of the values (m, k), by default all; gates use any.
    """
    # A term has at least two nodes, which limits the number of terms.
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

    Returns weights (terms + 1, k) for each target, at 0, 1, 2, … terms.
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

    # Keep the first of equal terms; for instance, a state times itself equals the state.
    unique = ~np.triu(np.abs(gram) > (1.0 - EQUAL) * len(targets), k=1).any(axis=0)
    usable, products, gram = usable[unique], products[unique], gram[np.ix_(unique, unique)]
    gram += PENALTY * len(targets) * np.eye(len(usable))

    # Pursue each target, in the scale of the terms.
    paths = []
    for product in products.T:
        weights = _pursue(gram, product, max_terms)
        path = np.zeros((len(weights), len(mean)))
        path[:, usable] = weights / spread[usable]
        paths.append(path)
    return paths


def _pursue(gram: Array, product: Array, max_terms: int) -> Array:
    """Returns the weights (terms + 1, candidates) at 0, 1, 2, … terms."""
    from sklearn.linear_model import orthogonal_mp_gram

    zeros, count = np.zeros((1, len(gram))), min(len(gram), max_terms)
    if count == 0:
        return zeros
    with warnings.catch_warnings():
        # The pursuit ends early if fewer terms fit exactly.
        warnings.filterwarnings("ignore", "Orthogonal matching pursuit ended prematurely")
        path = orthogonal_mp_gram(gram, product, n_nonzero_coefs=count, return_path=True)
    return np.concatenate([zeros, np.asarray(path).reshape(len(gram), -1).T])


def gated_expression(gates: Sequence[Expression], weights: Array, intercept: float) -> Expression:
    """Builds a gated sum from its weights (g + 1, n): those without a gate, then a row per gate."""
    total = constant(float(intercept))
    for gate, row in zip((None, *gates), weights, strict=True):
        columns = np.flatnonzero(row).tolist()
        terms = [scaled(variable(i), float(row[i])) for i in columns]
        if gate is not None and len(terms) == 1:
            # A single weight is written before the gate.
            (i,) = columns
            terms = [Expression("mul", (scaled(gate, float(row[i])), variable(i)))]
        elif gate is not None and terms:
            terms = [Expression("mul", (gate, reduce(plus, terms)))]
        for term in terms:
            total = Expression("add", (total, term))
    return total
