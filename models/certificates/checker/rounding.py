"""What double precision does to a formula: a bound of its error over a box, node by node.

Robots evaluate formulas in double precision, from left to right; bounds are of exact formulas. Each
node of the tree is bounded over the whole box, and with it how far the computed value may be from
the exact one (the running error of Higham, Accuracy and Stability of Numerical Algorithms, section
3.3). A function that may be asked for what it has no value of, or a value that may overflow, is
refused, also where it is multiplied by zero.
"""

from collections.abc import Callable

from flint import arb

from .robot import Box, Robot, refuse_unless
from .text import Node

UNIT = arb(2) ** -53
"""Error of one operation, as a share of its result."""

LIBRARY = 16
"""The same of a function, in units: NumPy's and C libraries' are within 4 of the last place."""

SMALLEST = arb(2) ** -1000
"""More than is lost where a result is too small for all its digits."""

GREATEST = arb(10) ** 300

LARGEST_ERROR = arb("1e-9")
"""Error of a target (rad) beyond which nothing is certified."""

Ranged = tuple[arb, arb, arb]
"""Least and greatest exact value, and greatest error."""


class Rounding:
    """Bounds values and errors of a robot's formulas over one box."""

    def __init__(self, robot: Robot, box: Box) -> None:
        self.robot, self.box, self.known = robot, box, dict[Node, Ranged]()

    def target(self, formula: Node, joint: str) -> arb:
        """Bounds the error of a joint's target (rad), as the robot computes it.

        A policy returns an action, which the robot turns into the target again.

        Raises:
            RefusedError: if it may exceed `LARGEST_ERROR`, or the formula may have no value.
        """
        low, high, error = self.ranged(formula)
        stance = abs(arb(self.robot.stance[joint]))
        error = upper(error + 4 * UNIT * (size(low, high) + error + stance))
        refuse_unless(
            error <= LARGEST_ERROR,
            f"a target of {joint} may be off by more than {LARGEST_ERROR.str(2, radius=False)} rad "
            "in double precision",
        )
        return error

    def ranged(self, node: Node) -> Ranged:
        if node not in self.known:
            self.known[node] = self.of(node)
        return self.known[node]

    def of(self, node: Node) -> Ranged:
        if node.operator == "constant":
            return arb(node.value), arb(node.value), arb(0)
        if node.operator == "variable":
            # A quantity is computed from what is observed: scaled, and shifted by its offset.
            low, high = map(arb, self.box[node.name])
            return (
                low,
                high,
                4 * UNIT * (size(low, high) + abs(arb(self.robot.units(node.name)[1]))),
            )
        parts = [self.ranged(part) for part in node.parts]
        if node.operator == "neg":
            low, high, error = parts[0]
            return -high, -low, error
        low, high, error = RULES[node.operator](*parts)
        share = LIBRARY if node.operator in APPLIED else 2
        error = upper(error + share * UNIT * (size(low, high) + error) + SMALLEST)
        refuse_unless(size(low, high) + error < GREATEST, f"{node.operator} may overflow")
        return low, high, error


def size(low: arb, high: arb) -> arb:
    return abs(low).max(abs(high))


def upper(value: arb) -> arb:
    """Returns the ball's upper end, so that balls of errors do not grow."""
    return arb(value.upper())


def add(a: Ranged, b: Ranged) -> Ranged:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def sub(a: Ranged, b: Ranged) -> Ranged:
    return a[0] - b[1], a[1] - b[0], a[2] + b[2]


def mul(a: Ranged, b: Ranged) -> Ranged:
    ends = [x * y for x in a[:2] for y in b[:2]]
    error = size(*a[:2]) * b[2] + size(*b[:2]) * a[2] + a[2] * b[2]
    return *hull(ends), error


def div(a: Ranged, b: Ranged) -> Ranged:
    away = b[0] if b[0] > 0 else -b[1]
    refuse_unless(away > b[2], "a formula divides by what may be 0")
    ends = [x / y for x in a[:2] for y in b[:2]]
    low, high = hull(ends)
    return low, high, (a[2] + size(low, high) * b[2]) / (away - b[2])


def square(a: Ranged) -> Ranged:
    low, high, error = mul(a, a)
    return low.max(arb(0)), high, error


def cube(a: Ranged) -> Ranged:
    whole = mul(a, a)
    # The first product is rounded, too.
    rounded = *whole[:2], whole[2] + 2 * UNIT * (size(*whole[:2]) + whole[2])
    return mul(rounded, a)


def wave(a: Ranged) -> Ranged:
    return arb(-1), arb(1), a[2]


def tanh(a: Ranged) -> Ranged:
    return a[0].tanh(), a[1].tanh(), a[2]


def exp(a: Ranged) -> Ranged:
    refuse_unless(a[1] + a[2] < 690, "exp may overflow")
    return a[0].exp(), a[1].exp(), (a[1] + a[2]).exp() * a[2]


def log(a: Ranged) -> Ranged:
    refuse_unless(a[0] > a[2], "log may be of what is not positive")
    return a[0].log(), a[1].log(), a[2] / (a[0] - a[2])


def sqrt(a: Ranged) -> Ranged:
    refuse_unless(a[0] > a[2], "sqrt may be of what is not positive")
    return a[0].sqrt(), a[1].sqrt(), a[2] / (a[0] - a[2]).sqrt()


def absolute(a: Ranged) -> Ranged:
    return arb(0), size(*a[:2]), a[2]


RULES: dict[str, Callable[..., Ranged]] = {
    "add": add,
    "sub": sub,
    "mul": mul,
    "div": div,
    "square": square,
    "cube": cube,
    "sin": wave,
    "cos": wave,
    "tanh": tanh,
    "exp": exp,
    "log": log,
    "sqrt": sqrt,
    "abs": absolute,
}
"""Exact values and errors of what is applied, its own rounding left out."""

APPLIED = ("sin", "cos", "tanh", "exp", "log", "sqrt", "abs")


def hull(values: list[arb]) -> tuple[arb, arb]:
    """Returns the least and the greatest of numbers."""
    least = greatest = values[0]
    for value in values[1:]:
        least, greatest = least.min(value), greatest.max(value)
    return least, greatest
