"""Formula files, read anew: header, machine, readings, definitions and formulas.

A formula is parsed as a Python expression, of which a few kinds of nodes are known; it is never
run. The grammar is written down where formula files are described.
"""

import ast
import math
import re
from collections.abc import Iterator
from itertools import product as ways
from typing import Any, NamedTuple

from .files import RefusedError, is_number, parse_yaml, refuse_unless
from .robot import DEFAULT_ROBOT, JOINTS, LEGS, MIRRORED, TURNED, Box, image_of, symbols

HEADER = ("format", "gait", "robot", "states", "senses", "mirror", "targets", "gains")
TITLE = r"contacts|odometry|machine|readings|definitions|every state|state [0-9]{1,2}|limits"
"""Sections. No proof needs contacts, odometry and limits, by which robots estimate and are sent."""

MACHINE = ("description", "states", "initial", "transitions", "dwell", "clearance")
MACHINE += ("max_speed", "max_yaw_rate")
FUNCTIONS = ("sin", "cos", "tanh")
DEEPEST, MOST_FACTORS, MOST_STATES = 100, 100, 32

WORD = r"[A-Za-z_][A-Za-z0-9_]*"
TOKEN = re.compile(
    r" *(?:(?:(?:0|[1-9][0-9]*)(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?(?![A-Za-z0-9_.])"
    rf"|{WORD}(?:\.{WORD})?(?!\.)|\*\* *[23](?![A-Za-z0-9_.])|\*(?!\*)|/(?!/)|[-+()])"
)
NUMBER = r"-?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
RANGE = re.compile(rf" *(?:([a-z]+) +)?({NUMBER}) +to +({NUMBER}) *")
STANCES = [dict(zip(LEGS, feet, strict=True)) for feet in ways((False, True), repeat=len(LEGS))]
"""All ways to touch the ground."""


class FormulaFile:
    """The parts of a formula file that a proof needs.

    Attributes:
        header: Keys and values before the first section.
        machine: The gait's machine.
        names: The quantities that formulas may hold.
        mirror: State that each state is in the mirror; None where a machine favours a side.
        readings: Least and greatest value of each quantity that is read in a range.
        definitions: Formulas that have names, of quantities.
        formulas: The formulas by state and joint; those that are images of others are left out.
    """

    def __init__(self, text: str, mirror: Any) -> None:
        plain = len(text) <= 1_000_000 and not re.search(r"[^\n -~]", text)
        refuse_unless(plain, "the policy's file is too long, or is not printable ASCII")
        parts = sections(text)
        self.header = read_header(parts[""])
        refuse_unless("machine" in parts, "the policy's file holds no machine")
        self.machine = read_machine("\n".join(parts["machine"]))
        n_states, self.mirror = len(self.machine["states"]), mirror
        refuse_unless(self.header["states"] == str(n_states), "the policy has other states")
        right = mirror is None or is_mirror(self.machine, mirror)
        refuse_unless(right, "its mirror is not that of the gait's machine")
        said = self.header.get("mirror")
        same = said is None or said.split() == [str(state) for state in mirror or ()]
        refuse_unless(same, "the policy's mirror is not that of the gait's machine")
        self.has_images, self.serves_every_state = said is not None, "every state" in parts
        self.names = symbols(n_states, "senses" in self.header)
        self.readings = read_readings([*statements(parts.get("readings", []))], self.names)
        self.definitions: dict[str, Formula] = {}
        for name, formula in map(_assigned, statements(parts.get("definitions", []))):
            taken = {*self.names, *self.definitions, *JOINTS, *FUNCTIONS}
            refuse_unless(name not in taken, f"{name[:40]!r} cannot be defined")
            self.definitions[name] = parse(formula)
        self.formulas: dict[tuple[int, str], Formula] = {}
        for title in parts:
            if title.startswith(("state ", "every state")):
                self.take_formulas(title, parts[title], n_states)
        for place in ways(range(n_states), JOINTS):
            self.used(*place)

    def take_formulas(self, title: str, lines: list[str], n_states: int) -> None:
        """Takes the formulas of one state, or of every state."""
        states = range(n_states) if title == "every state" else [int(title[6:])]
        refuse_unless(max(states) < n_states, f"there is no {title}")
        for joint, formula in map(_assigned, statements(lines)):
            refuse_unless(joint in JOINTS, f"{joint[:40]!r} is no joint")
            tree = parse(formula)
            for state in states:
                refuse_unless((state, joint) not in self.formulas, f"{joint} has two formulas")
                self.formulas[state, joint] = tree

    def evaluate(self, state: int, joint: str, algebra: Any, mirrored: bool = False) -> Any:
        """Works out a target, of quantities or of their images in the mirror."""
        formula, is_image, sign = self.formula(state, joint)
        found = self.worked_out(formula.tree, algebra, mirrored != is_image)
        return found if sign > 0 else -found

    def formula(self, state: int, joint: str) -> tuple["Formula", bool, int]:
        """Returns the formula of a target, whether it is of the image, and its sign there."""
        if (state, joint) in self.formulas:
            return self.formulas[state, joint], False, 1
        refuse_unless(self.has_images, f"{joint} has no formula in state {state}")
        other, sign = image_of(joint, self.mirror)
        place = self.mirror[state], other
        refuse_unless(place in self.formulas, f"{joint} has no formula in state {state}")
        return self.formulas[place], True, sign

    def named(self, name: str, mirrored: bool) -> "tuple[str | Formula, bool, int]":
        """Returns the quantity or formula that a name stands for, whether mirrored, and its sign."""
        if name in self.names:
            new, sign = image_of(name, self.mirror) if mirrored else (name, 1)
            return new, mirrored, sign
        if name in self.definitions:
            return self.definitions[name], mirrored, 1
        kind, _, place = name.partition(".")
        leg, under, rest = place.partition("_")
        other = f"{kind}.{MIRRORED.get(leg, leg)}{under}{rest}"
        known = self.has_images and other in self.definitions
        refuse_unless(known, f"{name[:40]!r} does not belong in a formula")
        return self.definitions[other], not mirrored, 1

    def worked_out(self, node: ast.expr, algebra: Any, mirrored: bool) -> Any:
        """Works out a formula, in which definitions stand for their formulas."""
        match node:
            case ast.Constant(value=number):
                return algebra.number(float(number))
            case ast.Name() | ast.Attribute():
                known = algebra.known
                key = ast.unparse(node), mirrored
                if key not in known:
                    what, turned, sign = self.named(*key)
                    is_quantity = isinstance(what, str)
                    found = (
                        algebra.quantity(what)
                        if is_quantity
                        else self.worked_out(what.tree, algebra, turned)
                    )
                    known[key] = found if sign > 0 else -found
                return known[key]
            case ast.UnaryOp(op=ast.USub(), operand=inner):
                return -self.worked_out(inner, algebra, mirrored)
            case ast.UnaryOp(operand=inner):
                return self.worked_out(inner, algebra, mirrored)
            case ast.Call(func=ast.Name(id=function), args=[inner]):
                return algebra.function(function, self.worked_out(inner, algebra, mirrored))
            case ast.BinOp(left=base, op=ast.Pow(), right=ast.Constant(value=int(power))):
                return algebra.power(self.worked_out(base, algebra, mirrored), power)
            case ast.BinOp(left=left, op=op, right=right):
                first, last = (self.worked_out(part, algebra, mirrored) for part in (left, right))
                match op:
                    case ast.Add():
                        return first + last
                    case ast.Sub():
                        return first - last
                    case ast.Mult():
                        return algebra.product(first, last)
                    case ast.Div():
                        return algebra.quotient(first, last)
        raise RefusedError("a formula holds what it must not")

    def used(self, state: int, joint: str) -> set[str]:
        """Returns the quantities that a target is written with, also those that cancel out."""
        formula, is_image, _ = self.formula(state, joint)
        return self.quantities(formula, is_image)

    def quantities(self, formula: "Formula", mirrored: bool) -> set[str]:
        """Returns the quantities of a formula or of its image, those of definitions included."""
        found = set[str]()
        for name in formula.names:
            what, turned, _ = self.named(name, mirrored)
            found |= {what} if isinstance(what, str) else self.quantities(what, turned)
        return found

    def read(self, box: Box) -> Box:
        """Returns what formulas read of a box: the nearer end of a range where it goes beyond."""
        clipped = dict(box)
        for name in self.readings.keys() & box.keys():
            low, high = self.readings[name]
            first, last = (min(max(end, low), high) for end in box[name])
            clipped[name] = first, last
        return clipped


class Formula(NamedTuple):
    """A formula and the names that it holds."""

    tree: ast.expr
    names: frozenset[str]


def parse(text: str) -> Formula:
    """Parses a formula, of which every token and every node is known."""
    at, names, text = 0, set[str](), text.strip(" ")
    while at < len(text):
        token = TOKEN.match(text, at)
        if token is None:
            raise RefusedError(f"{text[at : at + 20]!r} does not belong in a formula")
        at, word = token.end(), token[0].strip(" ")
        if word[0].isalpha() and not (word in FUNCTIONS and text[at:].lstrip(" ")[:1] == "("):
            names.add(word)
    try:
        tree = ast.parse(text, mode="eval").body
    except (SyntaxError, ValueError, MemoryError, RecursionError) as error:
        raise RefusedError(f"{text[:40]!r} is no formula") from error
    depth, factors = measured(tree)
    refuse_unless(depth <= DEEPEST, f"a formula is nested more than {DEEPEST} deep")
    refuse_unless(factors <= MOST_FACTORS, "a formula multiplies too often")
    return Formula(tree, frozenset(names))


def measured(node: ast.expr) -> tuple[int, int]:
    """Returns how deep a formula is nested, and the factors of its longest product."""
    match node:
        case ast.Constant(value=int(value) | float(value)):
            refuse_unless(abs(value) <= 1e30, f"{value:g} is too large a number")
            return 1, 1
        case ast.Name() | ast.Attribute():
            return 1, 1
        case ast.UnaryOp(operand=inner):
            depth, factors = measured(inner)
            return depth + 1, factors
        case ast.Call(func=ast.Name(id=name), args=[inner], keywords=[]):
            refuse_unless(name in FUNCTIONS, f"{name[:40]!r} is not checked")
            return measured(inner)[0] + 1, 1
        case ast.BinOp(left=base, op=ast.Pow(), right=ast.Constant(value=int(power))):
            depth, factors = measured(base)
            return depth + 1, power * factors
        case ast.BinOp(left=left, op=op, right=right):
            (one, a), (other, b) = measured(left), measured(right)
            refuse_unless(not isinstance(op, ast.Pow), "a power is no number")
            return max(one, other) + 1, a + b if isinstance(op, ast.Mult) else max(a, b)
    raise RefusedError("a formula holds what it must not")


def sections(text: str) -> dict[str, list[str]]:
    """Cuts a file at the titles of its sections; what stands before the first has the title ""."""
    lines: list[str] = []
    found = {"": lines}
    for line in text.split("\n"):
        bare = line.partition("#")[0].rstrip(" ")
        if re.fullmatch(TITLE, bare):
            refuse_unless(bare not in found, f"{bare!r} stands twice")
            found[bare] = lines = []
        else:
            lines.append(bare)
    shared = "every state" in found
    apart = any(title.startswith("state ") for title in found)
    refuse_unless(shared != apart, "formulas serve every state or one each")
    return found


def statements(lines: list[str]) -> Iterator[str]:
    """Joins each line with those that go on with it, and leaves out empty ones."""
    whole = ""
    for line in filter(None, lines):
        refuse_unless(whole or not line.startswith(" "), "a line goes on with none")
        if not line.startswith(" "):
            yield from [whole] if whole else []
            whole = ""
        whole += line
    yield from [whole] if whole else []


def read_header(lines: list[str]) -> dict[str, str]:
    """Reads the keys before the first section."""
    said: dict[str, str] = {}
    for line in statements(lines):
        key, colon, value = line.partition(":")
        refuse_unless(colon and key in HEADER, f"{line[:40]!r} is no line of a formula file")
        refuse_unless(key not in said, f"the policy says {key!r} twice")
        said[key] = value.strip(" ")
    refuse_unless(said.get("format") == "1", "the policy is of another format")
    refuse_unless(said.get("senses", "imu") == "imu", "the policy's senses are not known")
    refuse_unless({"gait", "states"} <= {*said}, "the policy's file names no gait or no states")
    return {"robot": DEFAULT_ROBOT, **said}


def _assigned(line: str) -> tuple[str, str]:
    found = re.fullmatch(rf"({WORD}(?:\.{WORD})?) *=(?!=)(.*)", line)
    if found is None:
        raise RefusedError(f"{line[:40]!r} is no line of a formula file")
    return found[1], found[2]


def read_readings(lines: list[str], names: list[str]) -> dict[str, tuple[float, float]]:
    """Reads the ranges in which formulas read what is sensed, and returns those of quantities."""
    said: dict[str, tuple[float, float]] = {}
    for line in lines:
        head, _, rest = line.partition(":")
        for part in rest.split(","):
            found = RANGE.fullmatch(part)
            if found is None:
                raise RefusedError("the policy's readings hold what is no range")
            member, low, high = found.groups()
            kind = f"{head}.{member}" if member else head
            refuse_unless(kind not in said, f"{kind} is read in two ranges")
            said[kind] = float(low), float(high)
            refuse_unless(-math.inf < said[kind][0] < said[kind][1] < math.inf, f"{kind} is empty")
    ends, used = dict[str, tuple[float, float]](), set[str]()
    for name in names:
        head, _, member = name.partition(".")
        kind = "h" if head == "h" else f"{head}.{member.rpartition('_')[2]}"
        if kind in said and head not in ("a", "t") and name != "cmd.t":
            low, high = said[kind]
            even = name not in TURNED or low == -high
            refuse_unless(even, f"the range of {kind} has another in the mirror")
            # Of right hips, whose angles have the other sign, it is the image of the left ones'.
            ends[name] = (-high, -low) if re.search(r"\.[FR]R_hip$", name) else (low, high)
            used.add(kind)
    refuse_unless(used == {*said}, "the policy's readings are of what is not observed")
    return ends


def read_machine(text: str) -> dict[str, Any]:
    """Reads the gait's machine, as far as proofs need it."""
    said = parse_yaml(text, "the policy's machine")
    keys = {*said} if isinstance(said, dict) else set()
    refuse_unless({*MACHINE} <= keys <= {*MACHINE, "faults"}, "the machine has other keys")
    states, dwell, edges = said["states"], said["dwell"], said["transitions"]
    names = isinstance(states, list) and all(isinstance(state, str) for state in states)
    names = names and 1 <= len({*states}) == len(states) <= MOST_STATES
    refuse_unless(names, "the machine names no states")
    whole = isinstance(dwell, list) and len(dwell) == 2 and all(type(own) is int for own in dwell)
    refuse_unless(whole and 1 <= dwell[0] <= dwell[1] <= 1000, "the machine has no dwell")
    for key in ("max_speed", "max_yaw_rate"):
        refuse_unless(is_number(said[key]) and 0 < said[key] <= 100, f"the machine has no {key}")
    sound = isinstance(edges, list) and all(
        isinstance(edge, dict) and {edge.get("from"), edge.get("to")} <= {*states} for edge in edges
    )
    refuse_unless(sound and said["initial"] in states, "the machine has other transitions")
    return said


def is_mirror(machine: dict[str, Any], image: Any) -> bool:
    """Returns whether a machine in the mirror is itself, its states renamed to their images."""
    states, faults = machine["states"], machine.get("faults", [])
    n = len(states)
    numbers = isinstance(image, list) and all(type(own) is int and 0 <= own < n for own in image)
    if not numbers or len(image) != n or [image[own] for own in image] != [*range(n)]:
        return False
    leaving: list[set[tuple]] = [set() for _ in states]
    mirrored: list[set[tuple]] = [set() for _ in states]
    for edge in machine["transitions"]:
        state, target = states.index(edge["from"]), states.index(edge["to"])
        rest = edge.get("dwell", 1.0), edge.get("grace", 0)
        leaving[state].add((fires(edge["when"]), target, *rest))
        mirrored[image[state]].add((fires(edge["when"], True), image[target], *rest))
    alike = all(
        (states[own] in faults) == (states[other] in faults) for own, other in enumerate(image)
    )
    return alike and leaving == mirrored


def fires(condition: Any, mirrored: bool = False) -> tuple[bool, ...]:
    """Returns in which stances a transition fires, such as by FL & ~RR, or by its mirror image."""
    plain = isinstance(condition, str) and re.fullmatch(r"[FLR&|~() ]{1,1000}", condition)
    refuse_unless(plain, "a transition has no condition")
    try:
        tree = ast.parse(str(condition).strip(), mode="eval").body
    except (SyntaxError, MemoryError, RecursionError) as error:
        raise RefusedError(f"{condition!r} is no condition") from error

    def holds(node: ast.expr, feet: dict[str, bool]) -> bool:
        match node:
            case ast.Name(id=leg) if leg in feet:
                return feet[leg]
            case ast.UnaryOp(op=ast.Invert(), operand=inner):
                return not holds(inner, feet)
            case ast.BinOp(left=left, op=ast.BitAnd() | ast.BitOr() as op, right=right):
                one, other = holds(left, feet), holds(right, feet)
                return one and other if isinstance(op, ast.BitAnd) else one or other
        raise RefusedError(f"{condition!r} is no condition")

    stances = STANCES
    if mirrored:
        stances = [{MIRRORED[leg]: down for leg, down in feet.items()} for feet in STANCES]
    return tuple(holds(tree, feet) for feet in stances)
