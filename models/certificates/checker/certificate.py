"""A certificate: every bound checked anew, and every claim decided from what holds."""

import hashlib
import json
import math
import re
import struct
from itertools import product as ways
from pathlib import Path
from typing import Any

from .formulas import Formulas
from .robot import (
    ABRUPT,
    ACTION_SCALE,
    COUNTED,
    EFFORT,
    JOINTS,
    LIMITS,
    STIFFNESS,
    Box,
    Question,
    RefusedError,
    image_of,
    refuse_unless,
    symbols,
)
from .tables import Tables, Trees, read_arrays

SLACK = 1e-9

Point = dict[str, float]


def read_policy(data: bytes, kind: str, n_states: int, gait: str) -> Formulas | Tables:
    """Reads what a policy's file says of the targets.

    Raises:
        RefusedError: if the policy is of another gait or kind.
    """
    if kind in ("symbolic", "statewise_symbolic"):
        return Formulas.read(data.decode(), n_states, gait)
    told, arrays = read_arrays(data)
    refuse_unless(told["gait"] == gait, "the policy is of another gait")
    same = len(told["observation_names"]) == len(symbols(n_states))
    refuse_unless(same, "the policy observes other things")
    readers = {"additive": Tables, "boosted_trees": Trees}
    readers |= dict.fromkeys(("linear", "statewise_linear"), Formulas.linear)
    refuse_unless(kind in readers, f"a policy of kind {kind!r} is not checked")
    return readers[kind](arrays, n_states)


class Check:
    """A certificate and the policy that it is of.

    Attributes:
        told: What the certificate says.
        targets: What the policy's file says.
        proved: The least bound that holds of each question and place.
    """

    def __init__(self, certificate: Path, policy: Path | None = None) -> None:
        told = self.told = json.loads(certificate.read_bytes())
        rest = {key: value for key, value in told.items() if key != "sha256"}
        text = json.dumps(rest, sort_keys=True, separators=(",", ":"))
        refuse_unless(
            hashlib.sha256(text.encode()).hexdigest() == told.get("sha256"),
            "the certificate was changed: its digest is of other contents",
        )
        refuse_unless(told["format"] == 1, "the certificate is of another format")
        own, self.n_states = told["policy"], len(told["states"])
        shipped = Path(__file__).parents[2] / "students" / told["gait"] / Path(own["file"]).name
        data = (policy or shipped).read_bytes()
        refuse_unless(
            hashlib.sha256(data).hexdigest() == own["sha256"],
            f"the policy {policy or shipped} is not the one that was certified",
        )
        self.targets = read_policy(data, own["kind"], self.n_states, told["gait"])
        self.names = symbols(self.n_states)
        for name, box in told["boxes"].items():
            sound = list(box) == self.names and all(
                type(low) is type(high) is float and low <= high for low, high in box.values()
            )
            refuse_unless(sound, f"the {name} box is no box of this gait's observations")
        self.proved: dict[tuple, float] = {}

    def run(self) -> str:
        """Checks statements, then claims, and tells how many hold."""
        for statement in self.told["statements"]:
            self.check_statement(statement)
        outcomes = [self.check_claim(claim) for claim in self.told["claims"]]
        told = [f"{outcomes.count(own)} {own}" for own in ("proved", "refuted", "undecided")]
        return f"{len(self.told['statements'])} bounds hold; claims: {', '.join(told)}"

    def box(self, where: str, stuck: list[str], state: int) -> Box:
        """Returns a box with the machine's state held."""
        boxes = self.told["boxes"]
        told = boxes[where] | {name: boxes["physical"][name] for name in stuck}
        box: Box = {name: (low, high) for name, (low, high) in told.items()}
        return box | {f"s{i}": (float(i == state), float(i == state)) for i in range(self.n_states)}

    def least(self, asked: Question, points: list[Point]) -> Any:
        """Returns what is asked, at a point, or as the change from the second to the first."""
        boxes = [{name: (value, value) for name, value in point.items()} for point in points]
        if len(points) == 1 or asked.name is None:
            return -self.targets.bound(asked._replace(sign=-asked.sign), boxes[0])
        rises = asked.of == "effect" or points[0][asked.name] >= points[1][asked.name]
        refuse_unless(rises, "the witnesses of a slope are in the wrong order")
        signs = zip(boxes, (-asked.sign, asked.sign), strict=True)
        target = Question("target", *asked[1:3], 1)
        return -sum(self.targets.bound(target._replace(sign=sign), box) for box, sign in signs)

    def check_statement(self, own: dict[str, Any]) -> None:
        name, stuck = own.get("observation"), own.get("stuck", [])
        asked = Question(own["of"], own["state"], own["joint"], own["sign"], name)
        told = f"{asked.of} of {asked.joint} in state {asked.state}"
        refuse_unless(asked.of in ("target", "offset", "slope", "effect"), f"{told}: is not known")
        refuse_unless(asked.sign in (1, -1), f"{told}: its sign is {asked.sign}")
        refuse_unless(asked.state in range(self.n_states), f"{told}: there is no such state")
        box = self.box(own["box"], stuck, asked.state)
        bound = self.targets.bound(asked, box, own.get("splits", []))
        refuse_unless(bound <= own["bound"], f"{told}: the bound {own['bound']} is not proved")
        points = [{name: low for name, (low, _) in box.items()} | own["witness"]]
        points += [points[0] | {str(name): own["other"]}] if "other" in own else []
        inside = all(holds(box, point) for point in points)
        refuse_unless(inside, f"{told}: the witness is not in the box")
        reached = self.least(asked, points) >= own["reached"] - SLACK
        refuse_unless(reached, f"{told}: the witness is too low")
        key = *asked, own["box"], *stuck
        self.proved[key] = min(own["bound"], self.proved.get(key, math.inf))

    def check_claim(self, claim: dict[str, Any]) -> str:
        """Decides a claim again, from bounds that hold or from its witnesses."""
        kind, outcome, points = claim["kind"], claim["outcome"], claim.get("witnesses", [])
        states = [self.told["states"].index(one) for one in claim.get("states", [])]
        scope = list(ways(states or range(self.n_states), claim.get("joints") or JOINTS))
        where, stuck = claim.get("box", "operating"), claim.get("stuck", [])
        for point in points:
            state = next(i for i in range(self.n_states) if point[f"s{i}"] == 1.0)
            inside = holds(self.box(where, stuck, state), point)
            refuse_unless(
                inside and (not states or state in states),
                f"{claim['name']}: its witness is not where the claim is made",
            )
            scope = [own for own in scope if own[0] == state] if outcome == "refuted" else scope
        decide = {"independent": self.depends, "mirror": self.lopsided, "change": self.abrupt}
        breaks = decide.get(kind, self.exceeds)
        right = outcome == "undecided"
        right |= outcome == "proved" and not breaks(claim, scope, [])
        right |= outcome == "refuted" and bool(points) and breaks(claim, scope, points)
        refuse_unless(right, f"{claim['name']}: is not {outcome}")
        return outcome

    def observations(self, claim: dict[str, Any], joint: str) -> list[str]:
        names = [re.sub(r"\.own$", f".{joint}", name) for name in claim["observations"]]
        refuse_unless({*names} <= {*self.names}, f"{claim['name']}: names unknown observations")
        return names

    def limits(self, claim: dict[str, Any], state: int, joint: str) -> list[tuple[Question, float]]:
        """Lists questions, and the limit that each exceeds nowhere."""
        up, down = (Question("target", state, joint, sign) for sign in (1, -1))
        match claim["kind"]:
            case "limits":
                low, high = LIMITS[joint[3:]]
                return [(up, claim.get("most", high)), (down, -claim.get("least", low))]
            case "torque":
                most = claim.get("most", EFFORT) / STIFFNESS
                return [(own._replace(of="offset"), most) for own in (up, down)]
            case "never" | "effect" as kind:
                asked = down if claim.get("never") == "falls" else up
                asked = asked._replace(of="slope" if kind == "never" else "effect")
                most = 0.0 if kind == "never" else claim["most"]
                used = self.targets.used(state, joint)
                names = [name for name in self.observations(claim, joint) if name in used]
                return [(asked._replace(name=name), most) for name in names]
        raise RefusedError(f"a claim of kind {claim['kind']!r} is not known")

    def exceeds(self, claim: dict[str, Any], scope: list, points: list[Point]) -> bool:
        """Tells whether a witness breaks a limit; without one, whether a bound is missing."""
        place = claim.get("box", "operating"), *claim.get("stuck", [])
        for state, joint in scope:
            for asked, limit in self.limits(claim, state, joint):
                if not points and not self.proved.get((*asked, *place), math.inf) <= limit:
                    return True
                if points:
                    other = [{asked.name: own[asked.name]} for own in points if asked.name]
                    if self.least(asked, [points[0] | own for own in other or [{}]]) > limit:
                        return True
        return False

    def apart(self, state: int, joint: str, points: list[Point]) -> Any:
        """Returns how far a target goes, at least, from one point to another."""
        asked = [Question("effect", state, joint, sign, self.names[0]) for sign in (1, -1)]
        return max(0.0, *(self.least(own, points) for own in asked))

    def depends(self, claim: dict[str, Any], scope: list, points: list[Point]) -> bool:
        for state, joint in scope:
            named = set(self.observations(claim, joint))
            if not points and named & self.targets.used(state, joint):
                return True
            alike = points and all(points[0][k] == points[1][k] for k in {*self.names} - named)
            if alike and self.apart(state, joint, points) > 0.0:
                return True
        return False

    def lopsided(self, claim: dict[str, Any], scope: list, points: list[Point]) -> bool:
        image = self.told["mirror"]
        for state, joint in scope:
            if not points and not self.targets.is_mirrored(state, joint, image):
                return True
            if points:
                turned = {name: image_of(name, image) for name in self.names}
                seen = {new: sign * points[0][name] for name, (new, sign) in turned.items()}
                theirs, turn = image_of(joint, image)
                for sign in (1, -1):
                    own = self.least(Question("target", state, joint, sign), [points[0]])
                    there = Question("target", image[state], theirs, -sign * turn)
                    if own + self.least(there, [seen]) > 0.0:
                        return True
        return False

    def abrupt(self, claim: dict[str, Any], scope: list, points: list[Point]) -> bool:
        changes, where = claim["changes"], claim.get("box", "operating")
        kinds = {name.partition(".")[0] for name in self.names}
        sound = all(most >= 0.0 for most in changes.values()) and {*changes} <= kinds | {
            *self.names
        }
        refuse_unless(sound, f"{claim['name']}: its changes are not of observations, or negative")
        by = {}
        for name in self.names:
            kind = name.partition(".")[0]
            by[name] = changes.get(name, 0.0 if kind == "cmd" else changes.get(kind, 0.0))
        if points:
            near = all(abs(points[0][k] - points[1][k]) <= by[k] + SLACK for k in by)
            refuse_unless(near, f"{claim['name']}: its witnesses are further apart than it says")
        squares = dict.fromkeys((state for state, _ in scope), 0.0)
        for state, joint in scope:
            if points:
                moved = self.apart(state, joint, points)
            else:
                box, used = self.box(where, [], state), sorted(self.targets.used(state, joint))
                along = [(name, by[name]) for name in used if by[name]]
                moved = sum(self.targets.moved(state, joint, *own, box) for own in along)
            squares[state] += (moved / ACTION_SCALE) ** 2
        limit = claim.get("most", ABRUPT)
        return any(own > limit if points else not own <= limit for own in squares.values())


def holds(box: Box, point: Point) -> bool:
    """Tells whether a box holds a point, whose counts are whole."""
    whole = all(point[name] == int(point[name]) for name in COUNTED)
    return whole and all(low <= point[name] <= high for name, (low, high) in box.items())


def check(certificate: Path, policy: Path | None = None) -> str:
    """Checks a certificate, and tells in a line what holds.

    Raises:
        RefusedError: if anything in it does not hold, or it cannot be read.
    """
    try:
        return Check(certificate, policy).run()
    except RefusedError:
        raise
    except (OSError, LookupError, TypeError, ValueError, ArithmeticError, AttributeError) as error:
        raise RefusedError(f"cannot be read ({type(error).__name__}: {error})") from error
    except (SyntaxError, StopIteration, RecursionError, MemoryError, struct.error) as error:
        raise RefusedError(f"cannot be read ({type(error).__name__}: {error})") from error
