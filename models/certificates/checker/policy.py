"""Formula files, read anew: what the header says, definitions and formulas.

A formula is parsed as a Python expression, of which a few kinds of nodes are known, and never run.
"""

import ast
import re
from collections.abc import Iterator
from itertools import product as ways
from operator import add, sub
from typing import Any

from .files import RefusedError, is_row, parse_yaml, refuse_unless
from .robot import DEFAULT_ROBOT, JOINTS, LEGS, MIRRORED, TURNED, Box, image_of, symbols

NEEDED = {"format", "gait", "states", "machine"}
KNOWN = NEEDED | {"robot", "senses", "mirror", "gains", "limited", "limits", "odometry", "readings"}
"""Keys of a header. No proof needs limits and odometry."""

MACHINE = {"description", "states", "initial", "transitions", "dwell", "clearance"}
MACHINE |= {"max_speed", "max_yaw_rate"}
FUNCTIONS = ("sin", "cos", "tanh")
MOST_STATES = 32

TITLE = re.compile(r"definitions|every state|state [0-9]{1,2}")
WORD = r"[A-Za-z_][A-Za-z0-9_]*"
TOKEN = re.compile(
    r" *(?:(?:(?:0|[1-9][0-9]*)(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?(?![A-Za-z0-9_.])"
    rf"|{WORD}(?:\.{WORD})?(?!\.)|\*\* *[23](?![A-Za-z0-9_.])|\*(?!\*)|/(?!/)|[-+()])"
)
STANCES = [dict(zip(LEGS, feet, strict=True)) for feet in ways((False, True), repeat=len(LEGS))]
"""All ways to touch the ground."""


class Names:
    """Arithmetic that only notes which quantities a formula holds."""

    def __init__(self) -> None:
        self.known, self.found = dict[Any, int](), set[str]()

    def quantity(self, name: str) -> int:
        self.found.add(name)
        return 0

    def number(self, *_: Any) -> int:
        return 0

    product = quotient = function = number


class FormulaFile:
    """The parts of a formula file that a proof needs.

    `mirror` is each state's image; `stiffness` is in N·m/rad, where the file says so. Formulas
    that are images of others are left out.
    """

    def __init__(self, text: str) -> None:
        # Read the header.
        plain = len(text) <= 1_000_000 and not re.search(r"[^\n -~]", text)
        refuse_unless(plain, "the policy's file is too long, or is not printable ASCII")
        parts = sections(text)
        said = parse_yaml("\n".join(parts.pop("")), "the policy's header")
        known = isinstance(said, dict) and NEEDED <= {*said} <= KNOWN
        refuse_unless(known, "the policy's header has other keys, or holds no machine")
        refuse_unless(said["format"] == 2, "the policy is of another format")
        refuse_unless(said.get("senses") in (None, "imu"), "the policy's senses are not known")
        self.header, self.machine = {"robot": DEFAULT_ROBOT, **said}, said["machine"]
        check_machine(self.machine)
        n_states, self.mirror = len(self.machine["states"]), said.get("mirror")
        refuse_unless(said["states"] == n_states, "the policy has other states")
        right = self.mirror is None or is_mirror(self.machine, self.mirror)
        refuse_unless(right, "the policy's mirror is not that of its machine")
        self.stiffness = None
        if (gains := said.get("gains")) is not None:
            sound = is_row(gains, 2) and 0.0 < gains[0] <= 1000.0 and 0.0 <= gains[1] <= 100.0
            refuse_unless(sound, "the policy's gains are no stiffness and damping")
            self.stiffness = float(gains[0])

        # Read the definitions, then the formulas.
        self.names = symbols(n_states, said.get("senses") is not None)
        self.readings = ranges_of(said.get("readings") or {}, self.names)
        self.definitions: dict[str, ast.expr] = {}
        for name, formula in assignments(parts.pop("definitions", [])):
            taken = {*self.names, *self.definitions, *JOINTS, *FUNCTIONS}
            refuse_unless(name not in taken, f"{name[:40]!r} cannot be defined")
            self.definitions[name] = parse(formula)
        self.formulas: dict[tuple[int, str], ast.expr] = {}
        for title, lines in parts.items():
            states = range(n_states) if title == "every state" else [int(title[6:])]
            refuse_unless(max(states) < n_states, f"there is no {title}")
            for joint, formula in assignments(lines):
                refuse_unless(joint in JOINTS, f"{joint[:40]!r} is no joint")
                for place in ways(states, [joint]):
                    refuse_unless(place not in self.formulas, f"{joint} has two formulas")
                    self.formulas[place] = parse(formula)

        # Every joint must have a formula, and every name in it a meaning.
        for place in ways(range(n_states), JOINTS):
            self.used(*place)

    def named(self, name: str, mirrored: bool, algebra: Any) -> Any:
        """Works out what a name stands for: a quantity or a definition."""
        if name in self.names:
            other, sign = image_of(name, self.mirror or []) if mirrored else (name, 1)
            found = algebra.quantity(other)
            return found if sign > 0 else -found
        if name in self.definitions:
            return self.worked_out(self.definitions[name], algebra, mirrored)

        # Of two legs' definitions a file need hold one.
        kind, _, place = name.partition(".")
        other = f"{kind}.{MIRRORED.get(place[:2], '?')}{place[2:]}"
        known = self.mirror is not None and other in self.definitions
        refuse_unless(known, f"{name[:40]!r} does not belong in a formula")
        return self.worked_out(self.definitions[other], algebra, not mirrored)

    def evaluate(self, state: int, joint: str, algebra: Any, mirrored: bool = False) -> Any:
        """Works out a target of quantities, or of their images in the mirror, in an algebra."""
        sign = 1
        if (state, joint) not in self.formulas and self.mirror is not None:
            joint, sign = image_of(joint, self.mirror)
            state, mirrored = self.mirror[state], not mirrored
        refuse_unless((state, joint) in self.formulas, f"{joint} has no formula in state {state}")
        found = self.worked_out(self.formulas[state, joint], algebra, mirrored)
        return found if sign > 0 else -found

    def worked_out(self, node: ast.expr, algebra: Any, mirrored: bool) -> Any:
        match node:
            case ast.Constant(value=int(number) | float(number)):
                return algebra.number(float(number))
            case ast.Name() | ast.Attribute():
                key = ast.unparse(node), mirrored
                if key not in algebra.known:
                    algebra.known[key] = self.named(*key, algebra)
                return algebra.known[key]
            case ast.UnaryOp(op=op, operand=inner):
                found = self.worked_out(inner, algebra, mirrored)
                return -found if isinstance(op, ast.USub) else found
            case ast.Call(func=ast.Name(id=function), args=[inner]) if function in FUNCTIONS:
                return algebra.function(function, self.worked_out(inner, algebra, mirrored))
            case ast.BinOp(left=base, op=ast.Pow(), right=ast.Constant(value=power)):
                base = self.worked_out(base, algebra, mirrored)
                square = algebra.product(base, base)
                return square if power == 2 else algebra.product(square, base)
            case ast.BinOp(left=left, op=op, right=right):
                parts = [self.worked_out(part, algebra, mirrored) for part in (left, right)]
                multiply, divide = algebra.product, algebra.quotient
                known = {ast.Add: add, ast.Sub: sub, ast.Mult: multiply, ast.Div: divide}
                if type(op) in known:
                    return known[type(op)](*parts)
        raise RefusedError(f"{ast.unparse(node)[:40]!r} does not belong in a formula")

    def used(self, state: int, joint: str) -> set[str]:
        """Returns the quantities that a target is written with, also those that cancel out."""
        names = Names()
        self.evaluate(state, joint, names)
        return names.found

    def read(self, box: Box) -> Box:
        """Returns what formulas read of a box: the nearer end of a range where it goes beyond."""
        clipped = {
            name: (min(max(box[name][0], low), high), min(max(box[name][1], low), high))
            for name, (low, high) in self.readings.items()
        }
        return box | clipped


def sections(text: str) -> dict[str, list[str]]:
    """Cuts a file at the titles of its sections; the header has the title ""."""
    lines: list[str] = []
    found = {"": lines}
    for line in text.split("\n"):
        bare = line.partition("#")[0].rstrip(" ")
        if TITLE.fullmatch(bare):
            lines = found.setdefault(bare, [])
        else:
            # YAML says where comments begin in the header.
            lines.append(line if lines is found[""] else bare)
    kinds = {title.partition(" ")[0] for title in found} - {"", "definitions"}
    refuse_unless(len(kinds) == 1, "formulas serve every state, or one each")
    return found


def assignments(lines: list[str]) -> Iterator[tuple[str, str]]:
    """Splits statements into names and formulas; an indented line goes on with the one above."""
    whole = re.sub(r"\n+ ", " ", "\n".join(filter(None, lines)))
    for line in filter(None, whole.split("\n")):
        found = re.fullmatch(rf"({WORD}(?:\.{WORD})?) *=(?!=)(.*)", line)
        if found is None:
            raise RefusedError(f"{line[:40]!r} is no line of a formula file")
        yield found[1], found[2]


def parse(text: str) -> ast.expr:
    """Parses a formula of known tokens."""
    at, text = 0, text.strip(" ")
    while at < len(text):
        token = TOKEN.match(text, at)
        if token is None:
            raise RefusedError(f"{text[at : at + 20]!r} does not belong in a formula")
        at = token.end()
    try:
        return ast.parse(text, mode="eval").body
    except (SyntaxError, ValueError, MemoryError, RecursionError) as error:
        # Python's parser gives up at deep nesting in several ways.
        raise RefusedError(f"{text[:40]!r} is no formula") from error


def ranges_of(said: Any, names: list[str]) -> dict[str, tuple[float, float]]:
    """Returns the ranges in which quantities are read, which are given by kind."""
    refuse_unless(isinstance(said, dict), "the policy's readings are none")
    ends, used = dict[str, tuple[float, float]](), set[str]()
    for name in names:
        head, _, member = name.partition(".")
        kind = "h" if head == "h" else f"{head}.{member.rpartition('_')[2]}"
        if kind in said and head != "a" and name != "cmd.t":
            sound = is_row(said[kind], 2) and said[kind][0] < said[kind][1]
            refuse_unless(sound, f"the range of {kind} is none")
            low, high = map(float, said[kind])
            even = name not in TURNED or low == -high
            refuse_unless(even, f"the range of {kind} has another in the mirror")
            # Angles of right hips have the other sign than those of left ones.
            ends[name] = (-high, -low) if re.search(r"\.[FR]R_hip$", name) else (low, high)
            used.add(kind)
    refuse_unless(used == {*said}, "the policy's readings are of what is not observed")
    return ends


def check_machine(said: Any) -> None:
    """Refuses a machine of other keys, or without the numbers that proofs need."""
    keys = {*said} if isinstance(said, dict) else set()
    refuse_unless(MACHINE <= keys <= MACHINE | {"faults"}, "the machine has other keys")
    states, dwell = said["states"], said["dwell"]
    names = isinstance(states, list) and all(isinstance(state, str) for state in states)
    names = names and 1 <= len({*states}) == len(states) <= MOST_STATES
    ends = {end for edge in said["transitions"] for end in (edge["from"], edge["to"])}
    refuse_unless(names and ends <= {*states}, "the machine names no states, or others")
    whole = is_row(dwell, 2) and all(type(own) is int for own in dwell)
    whole = whole and is_row([said["max_speed"], said["max_yaw_rate"]], 2)
    refuse_unless(whole and 1 <= dwell[0] <= dwell[1], "the machine has no dwell or no speeds")


def is_mirror(machine: dict[str, Any], image: Any) -> bool:
    """Returns whether a machine in the mirror is itself, its states renamed to their images."""
    states, faults = machine["states"], machine.get("faults", [])
    numbers = is_row(image, len(states)) and all(type(own) is int for own in image)
    if not numbers or sorted(image) != [*range(len(states))]:
        return False
    leaving, mirrored = set(), set()
    for edge in machine["transitions"]:
        ends = states.index(edge["from"]), states.index(edge["to"])
        rest = edge.get("dwell", 1.0), edge.get("grace", 0)
        leaving.add((*ends, fires(edge["when"]), *rest))
        mirrored.add((*(image[end] for end in ends), fires(edge["when"], True), *rest))
    alike = all((states[a] in faults) == (states[b] in faults) for a, b in enumerate(image))
    return alike and leaving == mirrored and all(image[image[own]] == own for own in image)


def fires(condition: Any, mirrored: bool = False) -> tuple[bool, ...]:
    """Returns in which stances a transition fires, such as by FL & ~RR, or by its mirror image."""
    text = " ".join(str(condition).split())
    refuse_unless(re.fullmatch(r"[FLR&|~() ]{1,1000}", text), "a transition has no condition")

    def holds(node: ast.expr, feet: dict[str, bool]) -> bool:
        match node:
            case ast.Name(id=leg):
                return feet[MIRRORED[leg] if mirrored else leg]
            case ast.UnaryOp(op=ast.Invert(), operand=inner):
                return not holds(inner, feet)
            case ast.BinOp(left=left, op=op, right=right):
                one, other = holds(left, feet), holds(right, feet)
                return one and other if isinstance(op, ast.BitAnd) else one or other
        raise RefusedError(f"{condition!r} is no condition")

    tree = ast.parse(text, mode="eval").body
    return tuple(holds(tree, feet) for feet in STANCES)
