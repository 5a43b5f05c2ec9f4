"""Formulas as exact polynomials, bounded in balls that hold all rounding."""

import math
import operator
from typing import Any

from flint import arb, ctx, fmpq, fmpq_mpoly, fmpq_mpoly_ctx

from .elimination import Elimination, Factor, Span
from .readings import Readings
from .robot import (
    COUNTED,
    BoundQuery,
    Box,
    RefusedError,
    Robot,
    image_of,
    refuse_unless,
)
from .rounding import Rounding, hull
from .text import FormulaText, Node

ctx.prec = 96

MOST_FUNCTIONS, MOST_TERMS, MOST_FACTORS = 100, 20_000, 100
OPERATORS = {"add": operator.add, "sub": operator.sub, "mul": operator.mul}


def exact(number: float) -> fmpq:
    """Returns the fraction that a double is."""
    refuse_unless(math.isfinite(number), f"{number} is no number")
    return fmpq(*float(number).as_integer_ratio())


class Formulas:
    """Targets as polynomials of quantities and of functions, each a variable of its own.

    Attributes:
        robot: The robot.
        inner: What each function is of, by the name of its variable.
        targets: The polynomials by state and joint, of those that were asked for.
        written: The formulas.
        readings: In which ranges these read what is sensed, where not in any.
    """

    def __init__(self, robot: Robot, quantities: list[str]) -> None:
        self.robot, self.quantities = robot, quantities
        self.names = [*quantities, "other", *(f"f{i}" for i in range(MOST_FUNCTIONS))]
        self.ring = fmpq_mpoly_ctx.get(self.names)
        self.variables = dict(zip(self.names, self.ring.gens(), strict=True))
        self.inner: dict[str, tuple[str, fmpq_mpoly]] = {}
        self.targets: dict[tuple[int, str], fmpq_mpoly] = {}
        self.written: dict[tuple[int, str], Node] = {}
        self.readings = Readings({})
        self.known: dict[Node, fmpq_mpoly] = {}
        self.listed: dict[str, list] = {}
        self.quantity = {name: i for i, name in enumerate(self.names)}
        self.origins: dict[str, set[int]] = {}

    @classmethod
    def read(cls, robot: Robot, text: FormulaText) -> "Formulas":
        """Takes what a formula file says."""
        own = cls(robot, text.names)
        own.written |= text.targets
        own.readings = text.readings or own.readings
        return own

    def target(self, state: int, joint: str) -> fmpq_mpoly:
        """Returns the polynomial of a target, multiplied out when it is first asked for."""
        place = state, joint
        if place not in self.targets:
            self.targets[place] = self.multiplied_out(self.written[place])
        return self.targets[place]

    def multiplied_out(self, node: Node) -> fmpq_mpoly:
        """Returns the polynomial that a formula is."""
        if node not in self.known:
            parts = [self.multiplied_out(part) for part in node.parts]
            self.known[node] = self.combined(node, parts)
        return self.known[node]

    def combined(self, node: Node, parts: list[fmpq_mpoly]) -> fmpq_mpoly:
        refuse_unless(node.degree <= MOST_FACTORS, "a formula multiplies too often")
        match node.operator, parts:
            case "constant", _:
                return self.ring.constant(exact(node.value))
            case "variable", _:
                return self.variables[node.name]
            case "neg", [inner]:
                return -inner
            case "square" | "cube", [inner]:
                power = 2 if node.operator == "square" else 3
                refuse_unless(len(inner) ** power <= MOST_TERMS, "a formula has too many terms")
                return inner**power
            case operator, [inner]:
                return self.applied(operator, inner)
            case operator, [a, b]:
                refuse_unless(len(a) * len(b) <= MOST_TERMS, "a formula has too many terms")
                if operator == "div":
                    return a * self.applied("inverse", b)
                return OPERATORS[operator](a, b)
        raise RefusedError(f"{node.operator!r} is not known")

    def applied(self, function: str, inner: fmpq_mpoly) -> fmpq_mpoly:
        """Returns the variable that a function of a polynomial is."""
        for name, own in self.inner.items():
            if own == (function, inner):
                return self.variables[name]
        name = f"f{len(self.inner)}"
        refuse_unless(name in self.variables, "a policy has too many functions to check")
        self.inner[name] = (function, inner)
        return self.variables[name]

    def put(self, formula: fmpq_mpoly, images: dict[str, fmpq_mpoly]) -> fmpq_mpoly:
        """Puts polynomials in the place of quantities."""
        used = set(self.names) - set(formula.unused_gens())
        places = self.variables | images
        for name in used & self.inner.keys():
            function, inner = self.inner[name]
            places[name] = self.applied(function, self.put(inner, images))
        return formula.compose(*places.values(), ctx=self.ring)

    def is_mirrored(self, state: int, joint: str, image: list[int]) -> bool:
        """Returns whether a target is the image of its image's, as exact numbers go."""
        theirs = image_of(joint, image)[0]
        put = {}
        for name in self.quantities:
            new, sign = image_of(name, image)
            put[name] = self.variables[new] * sign
        own = self.put(self.target(image[state], theirs), put) * image_of(theirs, image)[1]
        return self.target(state, joint) == own

    def used(self, state: int, joint: str) -> set[str]:
        """Returns the quantities that a target is written with, also those that cancel out."""
        return set(self.written[state, joint].names)

    def rounding(self, state: int, joint: str, box: Box) -> arb:
        """Bounds how far a target in double precision may be from the exact one (rad).

        Raises:
            RefusedError: if that is too far, or the formula may have no value in the box.
        """
        box = self.readings.applied(box)
        return Rounding(self.robot, box).target(self.written[state, joint], joint)

    def slope(self, formula: fmpq_mpoly, name: str) -> fmpq_mpoly:
        """Differentiates by a quantity."""
        whole = formula.derivative(name)
        for own in (set(self.names) - set(formula.unused_gens())) & self.inner.keys():
            along = self.slope(self.inner[own][1], name)
            if along:
                whole += formula.derivative(own) * self.outer(own) * along
        return whole

    def outer(self, name: str) -> fmpq_mpoly:
        """Differentiates a function by what it is of."""
        (function, inner), whole = self.inner[name], self.variables[name]
        slopes = {
            "tanh": lambda: 1 - whole**2,
            "sin": lambda: self.applied("cos", inner),
            "cos": lambda: -self.applied("sin", inner),
            "exp": lambda: whole,
            "inverse": lambda: -(whole**2),
            "log": lambda: self.applied("inverse", inner),
            "sqrt": lambda: self.applied("inverse", whole) * fmpq(1, 2),
        }
        refuse_unless(function in slopes, f"slopes of {function} are not checked")
        return slopes[function]()

    def moved(self, state: int, joint: str, name: str, most: float, box: Box) -> Any:
        """Bounds the change of a target where a quantity changes by `most` at most."""
        slopes = [
            self.bound(BoundQuery("slope", state, joint, sign, name), box) for sign in (1, -1)
        ]
        return arb(most) * slopes[0].max(slopes[1])

    def bound(self, asked: BoundQuery, box: Box, splits: list | None = None) -> Any:
        """Bounds what is asked from above over a box, cell by cell of a tree of splits."""
        formula, counted = self.target(asked.state, asked.joint), set[str](COUNTED)
        outside = False
        if asked.of == "slope":
            inside, outside = self.readings.reach(str(asked.name), box)
            if not inside:
                return arb(0)
        sensed, beyond = box, 0.0
        box = self.readings.applied(box)
        if asked.name is not None:
            box = {**box, "other": box[asked.name]}
            counted |= {"other"} if asked.name in COUNTED else set()
        match asked.of:
            case "offset":
                formula = formula - self.variables[f"q.{asked.joint}"]
                # No range holds back the angle that is taken away.
                beyond = self.readings.beyond(f"q.{asked.joint}", asked.sign, sensed)
            case "slope":
                formula = self.slope(formula, str(asked.name))
            case "effect":
                other = {str(asked.name): self.variables["other"]}
                formula = formula - self.put(formula, other)
        plan = Elimination(self.terms(formula * asked.sign), self.place)
        whole = self.greatest(plan, box, splits or [], counted) + arb(beyond)
        # What is beyond its range moves nothing.
        return whole.max(arb(0)) if outside else whole

    def terms(self, formula: fmpq_mpoly) -> list:
        """Lists coefficients with the variables, and their powers, that each is of."""
        return [
            (arb(number), [(self.names[i], power) for i, power in enumerate(powers) if power])
            for powers, number in formula.to_dict().items()
        ]

    def inner_terms(self, name: str) -> list:
        """Lists the terms of what a function is of, once."""
        if name not in self.listed:
            self.listed[name] = self.terms(self.inner[name][1])
        return self.listed[name]

    def place(self, factor: Factor) -> tuple[list[int], str, int, str]:
        """Orders factors as the prover does, which has no names for functions."""
        name, power = factor
        if name not in self.inner:
            return [self.quantity[name]], "variable", power, name
        return sorted(self.quantities_of(name)), self.inner[name][0], power, name

    def quantities_of(self, name: str) -> set[int]:
        """Returns by number which quantities a variable is of."""
        if name not in self.inner:
            return {self.quantity[name]}
        if name not in self.origins:
            inner = (own for _, term in self.inner_terms(name) for own, _ in term)
            self.origins[name] = set[int]().union(*map(self.quantities_of, inner))
        return self.origins[name]

    def greatest(self, plan: Elimination, box: Box, splits: list, counted: set[str]) -> arb:
        if not splits:
            return self.cell_bound(plan, box)
        name, cut, below, above = splits
        low, high = box[name]
        refuse_unless(low <= cut <= high, f"a split of {name} is outside of its cell")
        ends = (math.floor(cut), math.floor(cut) + 1) if name in counted else (cut, cut)
        first = self.greatest(plan, {**box, name: (low, ends[0])}, below, counted)
        return first.max(self.greatest(plan, {**box, name: (ends[1], high)}, above, counted))

    def cell_bound(self, plan: Elimination, box: Box) -> arb:
        """Bounds a sum over a cell, its factors taken for independent: affine in each."""
        self.spans: dict[str, Span] = {}
        return plan.greatest([self.power(own, box) for own in plan.factors])

    def power(self, factor: tuple[str, int], box: Box) -> Span:
        span, power = self.ranged(factor[0], box), factor[1]
        ends = [end**power for end in span]
        holds_zero = not (span[0] > 0 or span[1] < 0)
        return hull([*ends, arb(0)] if power % 2 == 0 and holds_zero else ends)

    def ranged(self, name: str, box: Box) -> Span:
        """Bounds a variable over a cell, once."""
        if name not in self.spans:
            self.spans[name] = self.bounded(name, box)
        return self.spans[name]

    def bounded(self, name: str, box: Box) -> Span:
        if name not in self.inner:
            return arb(box[name][0]), arb(box[name][1])
        function = self.inner[name][0]
        parts = [
            spanned([(number, number), *(self.power(own, box) for own in term)])
            for number, term in self.inner_terms(name)
        ]
        low, high = (sum((part[end] for part in parts), arb(0)) for end in (0, 1))
        holds_zero = not (low > 0 or high < 0)
        if function == "inverse":
            refuse_unless(not holds_zero, "a formula divides by what may be 0")
            return 1 / high, 1 / low
        refuse_unless(function not in ("log", "sqrt") or low > 0, f"{function} of what may be 0")
        ends = [abs(end) if function == "abs" else getattr(end, function)() for end in (low, high)]
        ends += [arb(0)] if function == "abs" and holds_zero else []
        if function in ("sin", "cos"):
            # Crests and troughs are where this is whole, and turn about.
            half = fmpq(function == "sin", 2)
            first, last = ((end / arb.pi() - half).floor().unique_fmpz() for end in (low, high))
            if first is None or last is None:
                raise RefusedError("it is not sure where a wave turns")
            turns = range(int(first) + 1, int(last) + 1)[:2]
            ends += [arb((-1) ** (turn % 2)) for turn in turns]
        return hull(ends)


def spanned(spans: list[Span]) -> Span:
    """Multiplies intervals."""
    whole, *others = spans or [(arb(1), arb(1))]
    for span in others:
        whole = hull([a * b for a in whole for b in span])
    return whole
