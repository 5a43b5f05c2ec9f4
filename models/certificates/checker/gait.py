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
    read_yaml,
    refuse_unless,
)
from .text import MOST_STATES, is_involution

MOST_CHARACTERS = 1000

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

    def __init__(self, path: Path) -> None:
        self.said = read_yaml(path)
        refuse_unless(isinstance(self.said, dict), f"{path} is no gait file")
        states, edges = self.said["states"], self.said["transitions"]
        plain = isinstance(states, list) and all(isinstance(own, str) for own in states)
        refuse_unless(plain and 0 < len(states) <= MOST_STATES, f"{path} names no states")
        short = isinstance(edges, list) and len(edges) <= MOST_STATES * len(STANCES)
        short = short and all(len(str(edge["when"])) <= MOST_CHARACTERS for edge in edges)
        refuse_unless(short, f"{path} holds too much for a gait")
        self.states: list[str] = states

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


def outward(low: float, high: float) -> tuple[float, float]:
    # What is off a fourth decimal by rounding alone is on it.
    return (
        math.floor(round(low * PLACES, 6)) / PLACES,
        math.ceil(round(high * PLACES, 6)) / PLACES,
    )


class Condition:
    """Evaluates a condition such as FL & (RR | ~FR), of which ~ binds most and | least."""

    def __init__(self, text: str, feet: dict[str, bool]) -> None:
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
