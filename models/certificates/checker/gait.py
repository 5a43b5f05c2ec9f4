"""A gait's file, read anew: its states, its mirror image, its commands and what a robot can be."""

import math
import re
from collections import deque
from collections.abc import Iterator
from itertools import product as ways
from pathlib import Path
from typing import Any

from .robot import (
    ANGLE_OVERRUN,
    FASTEST_JOINT,
    FASTEST_TRUNK,
    FASTEST_TURN,
    FOOT_HEIGHTS,
    LEGS,
    MIRRORED,
    OVERDUE,
    STEEPEST,
    Box,
    RefusedError,
    Robot,
    is_number,
    parse_yaml,
    read_yaml,
    refuse_unless,
)

MOST_CHARACTERS, MOST_STATES, DEEPEST = 1000, 32, 50

MOST = {"clearance": 1.0, "max_speed": 100.0, "max_yaw_rate": 100.0}
"""Greatest numbers of a gait."""
KEYS = ("description", "states", "initial", "transitions", "dwell", *MOST)

STANCES = [dict(zip(LEGS, feet, strict=True)) for feet in ways((False, True), repeat=len(LEGS))]
"""All ways to touch the ground."""

PLACES = 1e4
"""Numbers of boxes have four decimals, and angles are rounded outward to them."""


class Gait:
    """What a gait's file says.

    Attributes:
        said: The file's keys and values.
        states: Names of the machine's states, in order.
    """

    def __init__(self, said: Any, source: object) -> None:
        """
        Args:
            said: The file's keys and values.
            source: What a refusal calls it.
        """
        refuse_unless(isinstance(said, dict), f"{source} is no gait")
        keys = {*said}
        refuse_unless({*KEYS} <= keys <= {*KEYS, "faults"}, f"{source} has other keys than a gait")
        self.said = said
        self.states: list[str] = said["states"]
        self.check_values(source)
        for edge in said["transitions"]:
            self.check_edge(edge, source)
        self.check_machine(source)

    def check_values(self, source: object) -> None:
        said, states = self.said, self.states
        of_text = isinstance(states, list) and all(map(is_name, states))
        several = of_text and len({*states}) == len(states) and 1 < len(states) <= MOST_STATES
        refuse_unless(several, f"{source} names no states")
        faults = said.get("faults", [])
        inside = isinstance(faults, list) and all(
            own in states for own in [said["initial"], *faults]
        )
        refuse_unless(inside and len({*faults}) == len(faults), f"{source} names another state")
        dwell, description = said["dwell"], said["description"]
        whole = (
            isinstance(dwell, list) and len(dwell) == 2 and all(type(own) is int for own in dwell)
        )
        refuse_unless(whole and 1 <= dwell[0] <= dwell[1] <= 1000, f"{source} has no dwell")
        for key, most in MOST.items():
            refuse_unless(is_number(said[key]) and 0 < said[key] <= most, f"{source} has no {key}")
        refuse_unless(isinstance(description, str), f"{source} is not described")
        line = " ".join(description.split())
        plain = len(line) <= MOST_CHARACTERS // 2 and line.isprintable()
        edges = said["transitions"]
        few = isinstance(edges, list) and len(edges) <= MOST_STATES * len(STANCES)
        refuse_unless(plain and few, f"{source} holds too much for a gait")

    def check_edge(self, edge: Any, source: object) -> None:
        must = {"from", "to", "when"}
        known = isinstance(edge, dict) and must <= {*edge} <= {*must, "dwell", "grace"}
        refuse_unless(known, f"{source} has a transition with other keys")
        inside = edge["from"] in self.states and edge["to"] in self.states
        refuse_unless(inside, f"{source} has a transition of other states")
        when, share, grace = edge["when"], edge.get("dwell", 1.0), edge.get("grace", 0)
        short = isinstance(when, str) and len(" ".join(when.split())) <= MOST_CHARACTERS
        refuse_unless(short, f"{source} has a transition without a condition")
        sound = (
            is_number(share) and 0 <= share <= 1 and type(grace) is int and 0 <= grace <= 100_000
        )
        refuse_unless(sound, f"{source} has a transition of no dwell or grace")

    def check_machine(self, source: object) -> None:
        """Refuses states that are never entered, and transitions that may fire together."""
        reached = [self.said["initial"]]
        for state in reached:
            edges = [*self.leaving(self.states.index(state))]
            fires = [
                sum(own) for own in zip(*(self.signature(edge)[0] for edge in edges), strict=True)
            ]
            once = all(any(self.signature(edge)[0]) for edge in edges)
            refuse_unless(
                once and max(fires, default=0) <= 1, f"{source} leaves {state} by two ways"
            )
            reached += [
                own for own in dict.fromkeys(edge["to"] for edge in edges) if own not in reached
            ]
        refuse_unless({*reached} == {*self.states}, f"{source} has a state that is never entered")

    @classmethod
    def load(cls, path: Path) -> "Gait":
        """Reads a gait's file."""
        return cls(read_yaml(path), path)

    @classmethod
    def read(cls, text: str, source: object) -> "Gait":
        """Reads a gait that stands in another file."""
        return cls(parse_yaml(text.encode("ascii"), source), source)

    def acts_as(self, other: "Gait") -> bool:
        """Returns whether two gaits are the same, but for what they are called and described."""
        return self.acting() == other.acting()

    def acting(self) -> list[Any]:
        keys = ("initial", "clearance", "dwell", "max_speed", "max_yaw_rate")
        edges = [
            [edge["from"], edge["to"], self.signature(edge)] for edge in self.said["transitions"]
        ]
        return [self.states, self.said.get("faults", []), [self.said[key] for key in keys], edges]

    def mirrors(self, image: list[int] | None) -> bool:
        """Returns whether the machine in the mirror is the machine with its states renamed so.

        None stands for a machine that favours a side: the initial state then has no image.
        """
        first = self.states.index(self.said["initial"])
        found = [self.followed(first, other) for other in range(len(self.states))]
        known = next((own for own in found if own is not None), None)
        return image == known

    def followed(self, first: int, other: int) -> list[int] | None:
        """Follows all transitions from a state and from its image at once."""
        images, frontier = {first: other}, deque([first])
        while frontier:
            state = frontier.popleft()
            theirs = {
                self.signature(edge): self.target(edge) for edge in self.leaving(images[state])
            }
            for edge in self.leaving(state):
                target, image = self.target(edge), theirs.pop(self.signature(edge, True), None)
                if image is None or images.get(target, image) != image:
                    return None
                if target not in images:
                    images[target] = image
                    frontier.append(target)
            if theirs:
                return None
        whole = [images.get(state, -1) for state in range(len(self.states))]
        faults = [state in self.said.get("faults", []) for state in self.states]
        alike = is_involution(whole, len(whole)) and all(
            faults[own] == faults[image] for own, image in enumerate(whole)
        )
        return whole if alike else None

    def leaving(self, state: int) -> Iterator[dict[str, Any]]:
        return (edge for edge in self.said["transitions"] if edge["from"] == self.states[state])

    def target(self, edge: dict[str, Any]) -> int:
        return self.states.index(edge["to"])

    def signature(self, edge: dict[str, Any], mirrored: bool = False) -> tuple:
        """Returns when a transition fires, in the mirror or not, as nothing else decides it."""
        holds = []
        for stance in STANCES:
            feet = {MIRRORED[leg]: down for leg, down in stance.items()} if mirrored else stance
            holds.append(Condition(edge["when"], feet).read())
        return tuple(holds), float(edge.get("dwell", 1.0)), int(edge.get("grace", 0))

    def physical(self, robot: Robot, operating: Box) -> Box:
        """Returns the box of what a robot can be and its sensors can say, and of `operating`."""
        box = {}
        for name, ends in operating.items():
            low, high = self.limits(robot, name)
            box[name] = min(low, ends[0]), max(high, ends[1])
        return box

    def limits(self, robot: Robot, name: str) -> tuple[float, float]:
        shortest, longest = map(float, self.said["dwell"])
        kind, _, rest = name.partition(".")
        low, high = robot.limits.get(rest, (0.0, 0.0))
        match kind, rest:
            case "cmd", "t":
                return shortest, longest
            case "cmd", _:
                most = float(self.said["max_speed" if rest == "v" else "max_yaw_rate"])
                return -most, most
            case "q", _:
                return outward(low - ANGLE_OVERRUN, high + ANGLE_OVERRUN)
            case "dq", _:
                return -FASTEST_JOINT, FASTEST_JOINT
            case "a", _:
                return outward(low, high)
            case "t", _:
                return 0.0, longest + OVERDUE
            case "g", _:
                return -STEEPEST, STEEPEST
            case "w", _:
                return -FASTEST_TURN, FASTEST_TURN
            case "v", _:
                return -FASTEST_TRUNK, FASTEST_TRUNK
            case "h", _:
                return FOOT_HEIGHTS
        return 0.0, 1.0


def is_name(value: object) -> bool:
    """Returns whether a value may be the name of a state."""
    return (
        isinstance(value, str)
        and 0 < len(value) <= 40
        and value.isprintable()
        and value == value.strip()
    )


def is_involution(image: object, count: int) -> bool:
    """Returns whether numbers name each one's image, whose image is the number itself."""
    return (
        isinstance(image, list)
        and len(image) == count
        and all(type(own) is int and 0 <= own < count for own in image)
        and all(image[image[own]] == own for own in range(count))
    )


def outward(low: float, high: float) -> tuple[float, float]:
    # What is off a fourth decimal by rounding alone is on it.
    return (
        math.floor(round(low * PLACES, 6)) / PLACES,
        math.ceil(round(high * PLACES, 6)) / PLACES,
    )


class Condition:
    """Evaluates a condition such as FL & (RR | ~FR), of which ~ binds most and | least."""

    def __init__(self, text: str, feet: dict[str, bool]) -> None:
        brackets = [text[:end].count("(") - text[:end].count(")") for end in range(len(text))]
        refuse_unless(max(brackets, default=0) <= DEEPEST, "a condition is nested too deep")
        self.tokens = re.findall(r"[A-Z]{2}|[&|~()]|[^\s]", text)[::-1]
        self.feet = feet

    def read(self) -> bool:
        whole = self.any()
        refuse_unless(not self.tokens, "a transition's condition cannot be read")
        return whole

    def next(self, wanted: str) -> bool:
        found = bool(self.tokens) and self.tokens[-1] == wanted
        if found:
            self.tokens.pop()
        return found

    def any(self) -> bool:
        whole = self.all()
        while self.next("|"):
            other = self.all()
            whole = whole or other
        return whole

    def all(self) -> bool:
        whole = self.one()
        while self.next("&"):
            other = self.one()
            whole = whole and other
        return whole

    def one(self) -> bool:
        if self.next("~"):
            return not self.one()
        if self.next("("):
            whole = self.any()
            refuse_unless(self.next(")"), "a transition's bracket is never closed")
            return whole
        foot = self.tokens.pop() if self.tokens else ""
        if foot not in self.feet:
            raise RefusedError(f"a transition's condition names {foot!r}, which is no foot")
        return self.feet[foot]
