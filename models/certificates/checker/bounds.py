"""Bounds of polynomials over boxes, in balls of real numbers that hold all rounding.

An interval is a pair of balls, each about one number: its least and its greatest.
"""

import math
from itertools import product as ways
from typing import Any

from flint import arb, ctx, fmpq

from .polynomials import INNER, refuse_unless

ctx.prec = 96

MOST_CORNERS = 10


def hull(values: list) -> tuple:
    least = greatest = values[0]
    for value in values[1:]:
        least, greatest = least.min(value), greatest.max(value)
    return least, greatest


def greatest(polynomial: dict, box: dict[str, tuple], splits: list, counted: set[str]) -> Any:
    """Bounds a polynomial from above over a box, cell by cell of a tree of splits."""
    if not splits:
        return cell_bound(polynomial, box)
    name, cut, below, above = splits
    low, high = box[name]
    refuse_unless(low <= cut <= high, f"a split of {name} is outside of its cell")
    ends = (math.floor(cut), math.floor(cut) + 1) if name in counted else (cut, cut)
    halves = ({**box, name: (low, ends[0])}, below), ({**box, name: (ends[1], high)}, above)
    bounds = [greatest(polynomial, own, tree, counted) for own, tree in halves]
    return bounds[0].max(bounds[1])


def cell_bound(polynomial: dict, box: dict[str, tuple]) -> Any:
    """Bounds a polynomial over a cell, its factors taken for independent: affine in each."""
    elements = {element for monomial in polynomial for element in monomial}
    ranges = {(factor, power): powered(ranged(factor, box), power) for factor, power in elements}
    corners: list = []
    while len(corners) < MOST_CORNERS:
        meeting = [[e for e in monomial if e not in corners] for monomial in polynomial]
        meeting = [own for own in meeting if len(own) > 1]
        if not meeting:
            break
        corners.append(max(elements, key=lambda e: (sum(e in own for own in meeting), e)))
    groups: dict = {}
    for monomial, number in polynomial.items():
        rest = tuple(element for element in monomial if element not in corners)
        held = [corners.index(element) for element in monomial if element in corners]
        groups.setdefault(rest, []).append((arb(number), held))
    spans = [(terms, spanned([ranges[e] for e in rest])) for rest, terms in groups.items()]
    values = [arb("-inf")]
    for ends in ways(*(ranges[element] for element in corners)):
        whole = arb(0)
        for terms, (low, high) in spans:
            coefficient = sum(
                (math.prod([ends[i] for i in held], start=c) for c, held in terms), arb(0)
            )
            whole += (coefficient * low).max(coefficient * high)
        values.append(whole)
    return hull(values)[1]


def spanned(spans: list[tuple]) -> tuple:
    """Multiplies intervals."""
    whole = (arb(1), arb(1))
    for span in spans:
        whole = hull([a * b for a in whole for b in span])
    return whole


def powered(span: tuple, power: int) -> tuple:
    ends = [end**power for end in span]
    holds_zero = not (span[0] > 0 or span[1] < 0)
    return hull([*ends, arb(0)] if power % 2 == 0 and holds_zero else ends)


def ranged(factor: str, box: dict[str, tuple]) -> tuple:
    """Bounds a factor over a cell."""
    if factor not in INNER:
        return arb(box[factor][0]), arb(box[factor][1])
    function, inner = INNER[factor]
    parts = [
        spanned(
            [(arb(number),) * 2, *(powered(ranged(own, box), power) for own, power in monomial)]
        )
        for monomial, number in inner.items()
    ]
    low, high = (sum((part[end] for part in parts), arb(0)) for end in (0, 1))
    holds_zero = not (low > 0 or high < 0)
    if function == "inverse":
        refuse_unless(not holds_zero, "a formula divides by what may be 0")
        return 1 / high, 1 / low
    refuse_unless(function not in ("log", "sqrt") or low > 0, f"{function} of what may be 0")
    ends = [abs(end) if function == "abs" else getattr(end, function)() for end in (low, high)]
    if function == "abs" and holds_zero:
        ends.append(arb(0))
    if function in ("sin", "cos"):
        # Crests and troughs are where this is whole, and turn about.
        halves = fmpq(1, 2) if function == "sin" else fmpq(0)
        first, last = (_floor(end / arb.pi() - halves) for end in (low, high))
        ends += [arb((-1) ** (k % 2)) for k in range(first + 1, last + 1)][:2]
    return hull(ends)


def _floor(number: Any) -> int:
    whole = number.floor().unique_fmpz()
    refuse_unless(whole is not None, "it is not sure where a wave turns")
    return int(str(whole))


def value_at(polynomial: dict, point: dict[str, float]) -> Any:
    return sum(
        (
            arb(number)
            * math.prod(
                (ranged(f, {k: (v, v) for k, v in point.items()})[0] ** p for f, p in monomial),
                start=arb(1),
            )
            for monomial, number in polynomial.items()
        ),
        arb(0),
    )
