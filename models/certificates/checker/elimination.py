"""The greatest value of a polynomial where every factor is between two numbers of its own.

It is affine in each factor, so that it is greatest where each is at an end. What a term adds is a
table over the ends of its factors; tables are added up, and maximised over one factor after the
other.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from typing import Any

from flint import arb

MOST_TOGETHER = 10
"""Factors that may meet in a table; where more do, tables are maximised apart: a bound still."""

Span = tuple[arb, arb]
"""Least and greatest, each a ball about one number."""

Factor = tuple[str, int]
"""A variable and its power."""

Index = list[tuple[int, list[int]]]
"""Tables by number, and which entry of each is added to an entry of their sum."""


class Elimination:
    """Tables of terms, and the order in which they are added up and maximised.

    Attributes:
        factors: The factors, in order. An entry of a table has the first at its upper end where
            the lowest bit of its place is 1, the next by the next bit.
    """

    def __init__(
        self, terms: list[tuple[arb, list[Factor]]], place: Callable[[Factor], Any]
    ) -> None:
        """
        Args:
            terms: Coefficients, and the factors of each.
            place: By what factors are ordered.
        """
        self.factors = sorted({factor for _, term in terms for factor in term}, key=place)
        number = {factor: index for index, factor in enumerate(self.factors)}
        self.terms = [(value, sorted(number[own] for own in term)) for value, term in terms]
        self.scopes = [term for _, term in self.terms]
        self.steps: list[tuple[int, Index]] = []
        self.plan()

    def plan(self) -> None:
        """Maximises over that factor next which fewest others meet."""
        holding: list[set[int]] = [set() for _ in self.factors]
        for number, scope in enumerate(self.scopes):
            for own in scope:
                holding[own].add(number)
        met = [self.joined(numbers) for numbers in holding]
        left = list(range(len(self.factors)))
        while left:
            factor = min(left, key=lambda own: len(met[own]))
            left.remove(factor)
            for bucket in self.buckets(factor, holding[factor]):
                scope = sorted(self.joined(bucket))
                index = [(i, self.entries(self.scopes[i], scope)) for i in bucket]
                self.steps.append((scope.index(factor), index))
                rest = [own for own in scope if own != factor]
                for own in rest:
                    holding[own] = holding[own] - {*bucket} | {len(self.scopes)}
                self.scopes.append(rest)
            for own in met[factor] - {factor}:
                met[own] = self.joined(holding[own])

    def joined(self, numbers: Iterable[int]) -> set[int]:
        """Returns the factors of tables."""
        return set[int]().union(*(self.scopes[number] for number in numbers))

    def buckets(self, factor: int, numbers: Iterable[int]) -> list[list[int]]:
        """Groups a factor's tables, so that not too many factors meet in one."""
        groups: list[tuple[list[int], set[int]]] = []
        for number in sorted(numbers, key=lambda i: (-len(self.scopes[i]), i)):
            own = {*self.scopes[number]}
            room = (group for group in groups if len(group[1] | own) <= MOST_TOGETHER)
            bucket, together = next(room, ([], {factor}))
            if not bucket:
                groups.append((bucket, together))
            bucket.append(number)
            together |= own
        return [bucket for bucket, _ in groups]

    @staticmethod
    def entries(scope: Sequence[int], wider: Sequence[int]) -> list[int]:
        """Returns which entry of a table belongs to each of a table of more factors."""
        return _entries(tuple(wider.index(own) for own in scope), len(wider))

    def greatest(self, ends: list[Span]) -> arb:
        """Bounds the polynomial from above, given the ends of each factor."""
        tables = [self.table(value, [ends[own] for own in term]) for value, term in self.terms]
        for bit, index in self.steps:
            columns = [[tables[number][i] for i in places] for number, places in index]
            whole = [sum(row, arb(0)) for row in zip(*columns, strict=True)]
            upper = 1 << bit
            tables.append(
                [own.max(whole[i | upper]) for i, own in enumerate(whole) if not i & upper]
            )
        done = (table[0] for table in tables if len(table) == 1)
        return sum(done, arb(0))

    @staticmethod
    def table(value: arb, ends: list[Span]) -> list[arb]:
        """Multiplies a term out for every choice of its factors' ends."""
        places = range(2 ** len(ends))
        return [
            math.prod([own[i >> bit & 1] for bit, own in enumerate(ends)], start=value)
            for i in places
        ]


# Few choices of few factors come again and again.
@cache
def _entries(bits: tuple[int, ...], count: int) -> list[int]:
    return [
        sum((place >> bit & 1) << own for own, bit in enumerate(bits)) for place in range(2**count)
    ]
