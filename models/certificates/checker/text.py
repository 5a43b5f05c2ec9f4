"""Formula files, read anew: from characters to trees.

The grammar is written down where formula files are described. This reader shares no code with the
one that robots act by, and refuses what that one refuses.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from keyword import iskeyword
from typing import Any

from .gait import MOST_STATES, Gait, is_involution
from .limits import Limits
from .readings import Readings
from .robot import (
    DEFAULT_ROBOT,
    JOINTS,
    MIRRORED,
    RefusedError,
    image_of,
    is_number,
    parse_yaml,
    refuse_unless,
    stiffness_of,
    symbols,
)

FUNCTIONS = ("sin", "cos", "tanh", "exp", "log", "sqrt", "abs")
KEYS = ("format", "gait", "states")
"""Keys that a header must have."""
OPTIONAL = ("senses", "mirror", "gains", "limits", "odometry", "machine", "readings")
"""Keys that it may have, or leave empty."""
FURTHER = ("robot", "limited")
"""Keys that it may have."""
TITLE = re.compile(r"definitions|every state|state [0-9]{1,3}")
"""Titles of sections; the header ends where the first one stands."""
MOST_CHARACTERS, MOST_DEFINITIONS = 1_000_000, 200
DEEPEST, MOST_NODES, LARGEST = 100, 5000, 1e30

WORD = r"[A-Za-z_][A-Za-z0-9_]*"
DIGITS = r"(?:0|[1-9][0-9]*)"
TOKEN = re.compile(
    rf" *(?:(?P<number>(?:{DIGITS}(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)(?![A-Za-z0-9_.])"
    rf"|(?P<name>{WORD}(?:\.{WORD})?)(?!\.)"
    r"|(?P<power>\*\* *[23])(?![A-Za-z0-9_.])"
    r"|(?P<sign>\*(?!\*)|/(?!/)|[-+()]))"
)
OPERATORS = {"+": "add", "-": "sub", "*": "mul", "/": "div"}


@dataclass(frozen=True, eq=False)
class Node:
    """A part of a formula: "constant", "variable", or what is applied to its parts.

    Attributes:
        operator: Its name.
        parts: What it is applied to.
        value: The number, of a constant.
        name: The quantity, of a variable.
        depth: Nodes from here down to the lowest.
        size: Nodes from here down.
        degree: Factors of its longest product, numbers included.
    """

    operator: str
    parts: tuple["Node", ...] = ()
    value: float = 0.0
    name: str = ""
    depth: int = field(init=False)
    size: int = field(init=False)
    degree: int = field(init=False)

    def __post_init__(self) -> None:
        degrees = [own.degree for own in self.parts] or [1]
        products = {"mul": sum(degrees), "square": 2 * degrees[0], "cube": 3 * degrees[0]}
        whole = 1 if self.operator in FUNCTIONS else max(degrees)
        object.__setattr__(self, "degree", products.get(self.operator, whole))
        object.__setattr__(self, "depth", 1 + max((own.depth for own in self.parts), default=0))
        object.__setattr__(self, "size", 1 + sum(own.size for own in self.parts))

    def replaced(
        self, images: dict[str, "Node"], known: dict["Node", "Node"] | None = None
    ) -> "Node":
        """Puts formulas in the place of variables; a part that stands twice is built once."""
        if self.operator == "variable":
            return images.get(self.name, self)
        known = {} if known is None else known
        if self not in known:
            parts = tuple(part.replaced(images, known) for part in self.parts)
            known[self] = Node(self.operator, parts, self.value) if parts else self
        return known[self]

    @cached_property
    def names(self) -> frozenset[str]:
        """The variables that the formula is written with."""
        own = frozenset([self.name] if self.name else [])
        return own.union(*(part.names for part in self.parts))


class Formula:
    """Reads one formula by recursive descent."""

    def __init__(self, text: str, known: set[str]) -> None:
        self.tokens, self.at, self.known, self.brackets = list(tokens(text)), 0, known, 0

    def read(self) -> Node:
        whole = self.sum()
        refuse_unless(self.at == len(self.tokens), "a formula goes on where it should end")
        return whole

    def next(self, *wanted: str) -> str:
        """Takes the next token if it is one of these."""
        if self.at < len(self.tokens) and self.tokens[self.at][1] in wanted:
            self.at += 1
            return self.tokens[self.at - 1][1]
        return ""

    def sum(self) -> Node:
        whole = self.product()
        while sign := self.next("+", "-"):
            whole = fit(OPERATORS[sign], whole, self.product())
        return whole

    def product(self) -> Node:
        whole = self.signed()
        while sign := self.next("*", "/"):
            whole = fit(OPERATORS[sign], whole, self.signed())
        return whole

    def signed(self) -> Node:
        signs = []
        while sign := self.next("+", "-"):
            signs.append(sign)
        whole = self.power()
        for _ in range(signs.count("-")):
            constant = whole.operator == "constant"
            whole = Node("constant", value=-whole.value) if constant else fit("neg", whole)
        return whole

    def power(self) -> Node:
        whole = self.atom()
        if self.at < len(self.tokens) and self.tokens[self.at][0] == "power":
            self.at += 1
            whole = fit("square" if self.tokens[self.at - 1][1][-1] == "2" else "cube", whole)
        return whole

    def atom(self) -> Node:
        refuse_unless(self.at < len(self.tokens), "a formula ends before it is complete")
        kind, text = self.tokens[self.at]
        self.at += 1
        if kind == "number":
            refuse_unless(abs(float(text)) <= LARGEST, f"{text[:20]} is too large a number")
            return Node("constant", value=float(text))
        if kind == "name" and text in FUNCTIONS and self.next("("):
            return fit(text, self.bracketed())
        if kind == "name" and text in self.known:
            return Node("variable", name=text)
        refuse_unless(text == "(", f"{text[:40]!r} does not belong where it stands in a formula")
        return self.bracketed()

    def bracketed(self) -> Node:
        self.brackets += 1
        refuse_unless(self.brackets <= DEEPEST, f"brackets are more than {DEEPEST} deep")
        whole = self.sum()
        refuse_unless(self.next(")"), "a bracket is never closed")
        self.brackets -= 1
        return whole


def fit(operator: str, *parts: Node) -> Node:
    """Makes a node, unless a robot's reader would refuse it for its size."""
    whole = Node(operator, parts)
    refuse_unless(whole.depth <= DEEPEST, f"a formula is nested more than {DEEPEST} deep")
    refuse_unless(whole.size <= MOST_NODES, f"a formula has more than {MOST_NODES} nodes")
    return whole


def tokens(text: str) -> Iterator[tuple[str, str]]:
    """Cuts a formula into kinds and texts of its tokens."""
    text, end = text.strip(" "), 0
    while end < len(text):
        found = TOKEN.match(text, end)
        if found is None:
            raise RefusedError(f"{text[end : end + 20]!r} does not belong in a formula")
        end, kind = found.end(), str(found.lastgroup)
        yield kind, found[kind]


def statements(text: str) -> Iterator[list[str]]:
    """Joins each line with those that go on with it; comments and empty lines are left out."""
    whole: list[str] = []
    for line in text.split("\n"):
        said = bare(line)
        if said.startswith(" "):
            refuse_unless(whole, "a line goes on with none")
            whole.append(said)
        elif said:
            yield from [whole] if whole else []
            whole = [said]
    yield from [whole] if whole else []


@dataclass
class FormulaText:
    """What a formula file says.

    Attributes:
        header: Keys and values before the first section.
        targets: The formula of each state and joint, mirror images included, of quantities alone.
        given: Targets that the file itself holds.
        definitions: Formulas that have names.
        section: The section that is read.
        kinds: Whether formulas serve every state; empty before the first.
        machine: The gait, where the file holds it.
        limits: Limits, where the file has them.
        readings: In which ranges formulas read what is sensed, where the file says so.
        stiffness: Stiffness of the joints that the policy moves, where the file says it.
    """

    header: dict[str, Any]
    targets: dict[tuple[int, str], Node] = field(default_factory=dict)
    given: set[tuple[int, str]] = field(default_factory=set)
    definitions: dict[str, Node] = field(default_factory=dict)
    section: str = ""
    kinds: set[bool] = field(default_factory=set)
    machine: Gait | None = None
    limits: Limits | None = None
    readings: Readings | None = None
    stiffness: float | None = None

    @classmethod
    def read(cls, text: str) -> "FormulaText":
        refuse_unless(len(text) <= MOST_CHARACTERS, "the policy's file is too long")
        refuse_unless(
            not re.search(r"[^\n -~]", text),
            "the policy's file holds other characters than printable ASCII ones and line feeds",
        )
        lines = text.split("\n")
        titles = (i for i, line in enumerate(lines) if TITLE.fullmatch(bare(line)))
        first = next(titles, len(lines))
        source = "the policy's header"
        own = cls(parse_yaml("\n".join(lines[:first]).encode("ascii"), source))
        own.check_header()
        for statement, *more in statements("\n".join(lines[first:])):
            own.take(statement, more)
        own.finish()
        return own

    def check_header(self) -> None:
        """Checks the header's keys, and takes what they say."""
        said = self.header
        refuse_unless(isinstance(said, dict), "the policy's file has no header")
        refuse_unless(
            {*KEYS} <= {*said} <= {*KEYS, *OPTIONAL, *FURTHER}, "the policy's header has other keys"
        )
        for key in OPTIONAL:
            if said.get(key, 0) is None:
                del said[key]
        refuse_unless(said["format"] == 2 and is_number(said["format"]), "it is another format")
        for key in ("gait", "robot"):
            name = said.get(key, DEFAULT_ROBOT)
            refuse_unless(isinstance(name, str) and name, f"the policy's {key} is no name")
        refuse_unless(isinstance(said.get("limited", False), bool), "limited is no truth value")
        refuse_unless(said.get("senses", "imu") == "imu", "the policy's senses are not known")
        states = said["states"]
        counted = type(states) is int and 1 <= states <= MOST_STATES
        refuse_unless(counted, "the policy's states are no number")
        if "mirror" in said:
            image = said["mirror"]
            whole = isinstance(image, list) and all(type(own) is int for own in image)
            sound = whole and is_involution(image, states)
            refuse_unless(sound, "the policy's mirror does not name each state's image")
        if "gains" in said:
            gains = said["gains"]
            refuse_unless(
                isinstance(gains, list) and all(map(is_number, gains)),
                "the policy's gains are no numbers",
            )
            self.stiffness = stiffness_of(gains)
        if "limits" in said:
            self.limits = Limits.of(said["limits"])
        if "odometry" in said:
            odometry = said["odometry"]
            refuse_unless(
                isinstance(odometry, dict) and {*odometry} <= {"gain"}, "the odometry is unknown"
            )
            gain = odometry.get("gain", 0.15)
            refuse_unless(is_number(gain) and 0.0 < gain <= 1.0, "the odometry's gain is none")
        if "machine" in said:
            self.machine = Gait(said["machine"], "the policy's machine")
            same = len(self.machine.states) == states
            refuse_unless(same, "the policy's machine has other states")
            own = self.image is None or self.machine.mirrors(self.image)
            refuse_unless(own, "the policy's mirror is not that of its machine")
        if "readings" in said:
            self.readings = Readings.of(said["readings"], self.names)

    @property
    def n_states(self) -> int:
        return self.header["states"]

    @property
    def imu(self) -> bool:
        return "senses" in self.header

    @property
    def names(self) -> list[str]:
        """The quantities that formulas may hold."""
        return symbols(self.n_states, self.imu)

    @property
    def image(self) -> list[int] | None:
        """State that each state is in the mirror, where the file says so."""
        return self.header.get("mirror")

    def take(self, first: str, more: list[str]) -> None:
        assigned = re.fullmatch(r"([A-Za-z_][A-Za-z0-9_.]*) *=(?!=)(.*)", first)
        if TITLE.fullmatch(first):
            refuse_unless(not more, f"{first[:40]!r} goes on in the next line")
            self.begin(first)
        elif assigned:
            self.assign(assigned[1], " ".join([assigned[2], *more]))
        else:
            raise RefusedError(f"{first[:40]!r} is no line of a formula file")

    def begin(self, title: str) -> None:
        late = title == "definitions" and self.section
        refuse_unless(not late, "definitions stand too late, or twice")
        self.complete_definitions()
        if title.startswith("state "):
            refuse_unless(int(title[6:]) < self.n_states, f"there is no {title}")
        if title != "definitions":
            shared = {title == "every state"}
            refuse_unless(self.kinds <= shared, "formulas serve every state or one each, not both")
        self.section = title

    def complete_definitions(self) -> None:
        """Adds images of definitions of a leg, of which the file has none."""
        if (image := self.image) is None or self.section != "definitions":
            return
        for name, formula in [*self.definitions.items()]:
            kind, _, place = name.partition(".")
            leg, under, rest = place.partition("_")
            if leg in MIRRORED:
                seen = f"{kind}.{MIRRORED[leg]}{under}{rest}"
                self.definitions.setdefault(seen, in_mirror(formula, image, self.names))
        refuse_unless(len(self.definitions) <= MOST_DEFINITIONS, "too much is defined")

    def assign(self, name: str, text: str) -> None:
        observed = set(self.names)
        if self.section == "definitions":
            taken = name in {*observed, *self.definitions, *JOINTS}
            plain = re.fullmatch(rf"{WORD}(?:\.{WORD})?", name)
            refuse_unless(
                plain and not taken and not any(map(iskeyword, name.split("."))),
                f"{name[:40]!r} cannot be defined",
            )
            refuse_unless(len(self.definitions) < MOST_DEFINITIONS, "too much is defined")
            self.definitions[name] = Formula(text, observed).read()
            return
        refuse_unless(name in JOINTS, f"{name[:40]!r} is no joint")
        whole = Formula(text, {*observed, *self.definitions}).read().replaced(self.definitions)
        shared = self.section == "every state"
        for state in range(self.n_states) if shared else [int(self.section[6:])]:
            refuse_unless((state, name) not in self.given, f"{name} has two formulas")
            self.given.add((state, name))
            self.targets[state, name] = whole
        self.kinds = {shared}

    def finish(self) -> None:
        """Adds mirror images, and asks that there is a formula of each joint and state."""
        refuse_unless(self.section, "the policy's file holds no formulas")
        self.complete_definitions()
        if (image := self.image) is not None:
            for state, joint in sorted(self.given):
                place = image[state], image_of(joint, image)[0]
                if place not in self.given:
                    own = self.targets[state, joint]
                    self.targets[place] = mirrored(own, joint, image, self.names)
        places = {(state, joint) for state in range(self.n_states) for joint in JOINTS}
        refuse_unless(places == set(self.targets), "the policy's file lacks a formula of a joint")


def bare(line: str) -> str:
    """Returns a line without its comment."""
    return line.partition("#")[0].rstrip(" ")


def mirrored(formula: Node, joint: str, image: list[int], names: list[str]) -> Node:
    """Returns what the formula of a joint is for the joint's image."""
    whole = in_mirror(formula, image, names)
    return whole if image_of(joint, image)[1] > 0 else Node("neg", (whole,))


def in_mirror(formula: Node, image: list[int], names: list[str]) -> Node:
    """Returns a formula of what is seen in the mirror."""
    images = {}
    for name in names:
        new, sign = image_of(name, image)
        seen = Node("variable", name=new)
        images[name] = seen if sign > 0 else Node("neg", (seen,))
    return formula.replaced(images)
