"""Checks a certificate: its files, each bound, and each claim from bounds and witnesses."""

import hashlib
import json
import math
import re
from dataclasses import replace
from fractions import Fraction
from functools import cache
from itertools import product as ways
from pathlib import Path
from typing import Any, NamedTuple

from flint import arb

from .bounds import Polynomials, Ranged, Rounding
from .files import RefusedError, is_number, is_row, read_bytes, read_json, read_yaml, refuse_unless
from .policy import FormulaFile, is_mirror
from .robot import ABRUPT, COUNTED, DEFAULT_ROBOT, JOINTS, Box, Robot, image_of, is_robot_name

MODELS = Path(__file__).parents[2]
SHIPPED_CLAIMS = [MODELS / "certificates" / name for name in ("claims.yaml", "claims_imu.yaml")]

ROUNDING = 2e-9
"""By how much a refutation must exceed its limit (rad): more than the errors of two targets."""

TOP = {"format", "gait", "mirror", "policy", "box", "claims", "statements", "sha256"}
STATEMENT = {"of", "state", "joint", "sign", "box", "bound"}
WRITTEN = {"name", "kind", "outcome", "worst", "claimed", "where", "witnesses"}
SCOPE = {"joints", "states", "box"}
KINDS = {
    "limits": (set(), {"least", "most", "stuck"}),
    "never": ({"observations", "never"}, {"most", "stuck"}),
    "effect": ({"observations", "most"}, {"stuck"}),
    "mirror": (set(), set()),
    "change": ({"changes"}, {"most"}),
}
"""Keys that claims of each kind must have, and those that they may have."""

CHOICES = {
    "of": ("target", "slope", "effect"),
    "sign": (1, -1),
    "box": ("operating", "physical"),
    "outcome": ("proved", "refuted", "undecided"),
    "never": ("rises", "falls"),
    "joint": JOINTS,
    "kind": tuple(KINDS),
}
USUAL: dict[str, Any] = {"kind": None, "never": None, "box": "operating", "changes": {}}
USUAL |= {key: [] for key in ("joints", "states", "stuck", "observations")}
"""Keys of a claim besides its numbers, and the values that they have where they are left out."""

Point = dict[str, float]

Place = tuple[str, ...]
"""A box by name, then the observations that may be anywhere in the physical one."""


class Query(NamedTuple):
    """A joint's target, its slope by a quantity or the effect of one, times a sign."""

    of: str
    state: int
    joint: str
    sign: int
    name: Any = None


class Check:
    """A certificate, its robot and policy, and the least bound proved of each query and place."""

    def __init__(self, certificate: Path, policy: Path | None, robot: Path | None) -> None:
        # The certificate must be whole.
        self.content = read_json(read_bytes(certificate))
        sound = isinstance(self.content, dict) and {*self.content} - {"robot"} == TOP
        refuse_unless(sound, "it is no certificate")
        rest = {key: value for key, value in self.content.items() if key != "sha256"}
        text = json.dumps(rest, sort_keys=True, separators=(",", ":"))
        same = hashlib.sha256(text.encode()).hexdigest() == self.content["sha256"]
        refuse_unless(same, "the certificate was changed: its digest is of other contents")
        of = self.content["format"]
        refuse_unless(type(of) is int and of == 2, "the certificate is of another format")

        # Read what it is of.
        self.robot = self.read_robot(robot)
        self.file = self.read_policy(policy)
        self.names, self.states = self.file.names, self.file.machine["states"]
        self.sensed = [name for name in self.names if not re.fullmatch(r"s\d+", name)]
        self.boxes = self.read_boxes(self.content["box"])
        self.polynomials = Polynomials(self.names)
        self.polynomial, self.error = cache(self.multiplied_out), cache(self.rounding)
        self.proved: dict[tuple, float] = {}

    def read_robot(self, given: Path | None) -> Robot:
        """Reads the file of the robot that the certificate names, and refuses that of another."""
        name = self.content.get("robot", DEFAULT_ROBOT)
        refuse_unless(is_robot_name(name), f"{str(name)[:60]!r} is no name of a robot")
        shipped = MODELS / "robots" / name / "robot.yaml"
        found = given or shipped.is_file()
        refuse_unless(found, f"no robot {name!r} ships with the project; name its file by --robot")
        path = given or shipped
        robot = Robot.read(path)
        same = not shipped.is_file() or robot == Robot.read(shipped)
        refuse_unless(same, f"{path} is not the {name} that ships; give your robot another name")
        refuse_unless(robot.name == name, f"{path} is the file of another robot than the {name}")
        return robot

    def read_policy(self, given: Path | None) -> FormulaFile:
        """Reads the policy's file, and refuses another one than the certificate's."""
        content, said = self.content, self.content["policy"]
        gait, file, mirror = content["gait"], said["file"], content["mirror"]
        path = given or self.shipped("students", f"{gait}/{file}")
        ships = re.fullmatch(r"\w+/\w+\.formulas", f"{gait}/{file}") and path.is_file()
        known = given or ships
        refuse_unless(known, f"no policy {file!r} ships with the project; name it by --policy")
        data = read_bytes(path)
        same = hashlib.sha256(data).hexdigest() == said["sha256"]
        refuse_unless(same, f"the policy {path} is not the one that was certified")
        read = FormulaFile(data.decode("ascii"))
        refuse_unless(read.header["gait"] == gait, "the policy is of another gait")
        refuse_unless(read.header["robot"] == self.robot.name, "the policy is of another robot")

        # A policy that says nothing of a mirror may have that of its machine.
        alike = read.mirror == mirror or (read.mirror is None and is_mirror(read.machine, mirror))
        refuse_unless(alike, "its mirror is not that of the policy")
        read.mirror = mirror
        if read.stiffness is not None:
            self.robot = replace(self.robot, stiffness=read.stiffness)
        return read

    def shipped(self, folder: str, rest: str) -> Path:
        """Returns where a file of the robot ships."""
        robot = "" if self.robot.name == DEFAULT_ROBOT else self.robot.name
        return MODELS / folder / robot / rest

    def read_boxes(self, said: Any) -> dict[str, Box]:
        """Reads the operating box, and returns it and what the robot and its sensors can be."""
        refuse_unless([*said] == self.names, "the box is not of this policy's observations")
        boxes: dict[str, Box] = {"operating": {}, "physical": {}}
        for name, ends in said.items():
            refuse_unless(is_row(ends, 2) and ends[0] <= ends[1], f"the box of {name} is none")
            low, high = map(float, ends)
            least, most = self.robot.physical(name, self.file.machine)
            boxes["operating"][name] = low, high
            boxes["physical"][name] = min(low, least), max(high, most)
            whole = name not in COUNTED or (low == int(low) >= least and high == int(high) <= most)
            refuse_unless(whole, f"the operating box of {name} holds other counts than there are")
        return boxes

    def run(self) -> str:
        """Checks statements, then claims, and reports how many hold."""
        n_statements, claims = len(self.content["statements"]), self.content["claims"]
        for statement in self.content["statements"]:
            self.check_statement(statement)
        outcomes = [self.check_claim(claim) for claim in claims]
        n_foreign = self.count_foreign(claims)
        words = zip(CHOICES["outcome"], ("proved", "refuted", "open"), strict=True)
        counts = ", ".join(f"{outcomes.count(outcome)} {word}" for outcome, word in words)
        foreign = f" ({n_foreign} named by its author only)" if n_foreign else ""
        ships = "is the one that ships" if self.box_ships() else "is taken on trust"
        return f"{n_statements} bounds hold; claims: {counts}{foreign}; its operating box {ships}"

    def box_ships(self) -> bool:
        """Returns whether the operating box ships, and was measured with this machine."""
        file = f"{self.content['gait']}.yaml"
        box, gait = self.shipped("certificates/boxes", file), MODELS / "task" / "gaits" / file
        if not (re.fullmatch(r"\w+\.yaml", file) and box.is_file() and gait.is_file()):
            return False
        same = {**read_yaml(gait), "description": ""} == {**self.file.machine, "description": ""}
        return same and read_yaml(box)["ranges"] == self.content["box"]

    def count_foreign(self, claims: list[dict[str, Any]]) -> int:
        """Counts claims that do not ship, and refuses one under the name of another that does."""
        names = [claim["name"] for claim in claims]
        refuse_unless(len({*names}) == len(names), "a claim stands twice")
        ships = {one["name"]: one for path in SHIPPED_CLAIMS for one in read_yaml(path)["claims"]}
        weakest = min(self.robot.effort.values()) / self.robot.stiffness
        for claim in claims:
            if said := ships.get(claim["name"]):
                same = all(claim.get(key, own) == said.get(key, own) for key, own in USUAL.items())
                same &= {"most", "least"} & {*claim} == ({"most"} if "limit" in said else set())
                same &= said.get("limit") != "torque" or claim.get("most", 0) <= weakest + ROUNDING
                other = "says something else than the claim that ships by this name"
                refuse_unless(same, f"{claim['name']}: {other}")
        return sum(name not in ships for name in names)

    def box(self, place: Place, state: int) -> Box:
        """Returns a box with the machine's state held."""
        where, *stuck = place
        taken = {name: self.boxes["physical"][name] for name in stuck}
        held = (float(i == state) for i in range(len(self.states)))
        return self.boxes[where] | taken | {f"s{i}": (one, one) for i, one in enumerate(held)}

    def rounding(self, state: int, joint: str, place: Place) -> arb:
        """Bounds what double precision does to a target over a box (rad)."""
        arithmetic = Rounding(self.robot, self.file.read(self.box(place, state)))
        return arithmetic.target(self.file.evaluate(state, joint, arithmetic), joint)

    def at(self, state: int, joint: str, point: Point, mirrored: bool = False) -> Ranged:
        """Returns a target at an observation, or at its image in the mirror."""
        box = self.file.read({name: (value, value) for name, value in point.items()})
        return self.file.evaluate(state, joint, Rounding(self.robot, box), mirrored)

    def multiplied_out(self, of: str, state: int, joint: str, name: Any = None) -> Any:
        """Returns a target, a slope or an effect as a polynomial."""
        if of == "target":
            return self.file.evaluate(state, joint, self.polynomials)
        target = self.polynomial("target", state, joint)
        if of == "slope":
            return self.polynomials.slope(target, str(name))
        return target - self.file.evaluate(state, joint, self.polynomials.replacing(str(name)))

    def bound(self, asked: Query, sensed: Box, splits: list | None = None) -> arb:
        """Bounds what is asked from above over a box, cell by cell of a tree of splits."""
        (of, state, joint, sign, name), box = asked, self.file.read(sensed)
        if name is None:
            formula, counted = self.polynomial(of, state, joint), COUNTED
        else:
            formula, box["other"] = self.polynomial(of, state, joint, name), box[name]
            counted = (*COUNTED, "other") if name in COUNTED else COUNTED
        bound = self.polynomials.greatest(formula * sign, box, splits or [], counted)
        if of == "slope" and name in self.file.readings:
            # A quantity that is beyond the range of its reading moves nothing.
            (low, high), (first, last) = self.file.readings[name], sensed[name]
            if last < low or first > high:
                return arb(0)
            return bound.max(arb(0)) if first < low or last > high else bound
        return bound

    def check_statement(self, said: dict[str, Any]) -> None:
        """Checks a bound, and keeps it."""
        self.check_keys(said, STATEMENT, {"observation", "stuck", "splits"}, "a statement")
        name, place = said.get("observation"), (said["box"], *sorted(said.get("stuck", [])))
        asked = Query(said["of"], said["state"], said["joint"], said["sign"], name)
        what = f"{asked.of} of {asked.joint} in state {asked.state}"
        refuse_unless((name is None) == (asked.of == "target"), f"{what}: of no observation")
        counts = asked.of == "slope" and name in COUNTED
        refuse_unless(not counts, f"{what}: {name} counts steps, and has no slope")
        # A slope is one of the exact target, from which no computed one is further than its error.
        error = self.error(asked.state, asked.joint, place)
        error *= {"target": 1, "slope": 0, "effect": 2}[asked.of]
        bound = self.bound(asked, self.box(place, asked.state), said.get("splits", [])) + error
        refuse_unless(bound <= said["bound"], f"{what}: the bound {said['bound']} is not proved")
        key = *asked, *place
        self.proved[key] = min(said["bound"], self.proved.get(key, math.inf))

    def check_claim(self, claim: dict[str, Any]) -> str:
        """Decides a claim again, from bounds that hold or from its witnesses."""
        # Its keys and values must be known.
        what, kind = repr(claim.get("name"))[:60], str(claim.get("kind"))
        refuse_unless(kind in KINDS, f"{what}: a claim of kind {kind!r} is not known")
        must, may = KINDS[kind]
        self.check_keys(claim, WRITTEN | must, SCOPE | may, what)
        outcome, points = claim["outcome"], claim["witnesses"]
        claim = {**USUAL, **claim}
        claim["place"] = claim["box"], *sorted(claim["stuck"])

        # Its witnesses must be in its box, and in one of its states.
        numbers = range(len(self.states))
        states = [self.states.index(one) for one in claim["states"]] or numbers
        scope = [*ways(states, claim["joints"] or JOINTS)]
        for point in points:
            state = next((i for i in numbers if point.get(f"s{i}") == 1.0), -1)
            box = self.box(claim["place"], state)
            within = (low <= point[name] <= high for name, (low, high) in box.items())
            inside = [*point] == self.names and all(within)
            whole = inside and all(point[name] == int(point[name]) for name in COUNTED)
            refuse_unless(whole, f"{what}: its witness is not where the claim is made")
            scope = [place for place in scope if place[0] == state]
        needed = {"effect": 2, "change": 2}.get(kind, 1) if outcome == "refuted" else 0
        refuse_unless(len(points) == needed, f"{what}: has another number of witnesses")

        # It must be what it is said to be.
        decide = {"mirror": self.lopsided, "change": self.abrupt}.get(kind, self.exceeds)
        if outcome != "undecided":
            broken = decide(claim, scope, points)
            refuse_unless(broken == (outcome == "refuted"), f"{what}: is not {outcome}")
        return outcome

    def check_keys(self, said: Any, must: set[str], may: set[str], what: str) -> None:
        """Refuses keys that are missing or of no use, and values of another kind."""
        known = isinstance(said, dict) and must <= {*said} <= must | may
        refuse_unless(known, f"{what}: has other keys than it must have")
        for key, value in said.items():
            sound = self.is_sound(key, value, said.get("kind"))
            refuse_unless(sound, f"{what}: its {key!r} is not what it must be")

    def is_sound(self, key: str, value: Any, kind: str | None) -> bool:
        """Returns whether a key of a claim or a statement may have a value."""
        listed = {"joints": JOINTS, "states": self.states, "stuck": self.sensed}
        listed["observations"] = [*self.sensed, "q.own", "dq.own", "a.own"]
        if key in listed:
            texts = isinstance(value, list) and all(isinstance(own, str) for own in value)
            known = texts and {*value} <= {*listed[key]} and len({*value}) == len(value)
            # Counts of steps have no slope.
            counts = kind == "never" and key == "observations" and known and {*value} & {*COUNTED}
            return known and not counts and bool(value or key != "observations")
        if key in CHOICES:
            return type(value) in (str, int) and value in CHOICES[key]
        if key == "changes":
            kinds = {name.partition(".")[0] for name in self.sensed} - {"cmd"}
            known = isinstance(value, dict) and {*value} <= {*self.sensed, *kinds}
            return known and all(is_number(most) and most >= 0.0 for most in value.values())
        if key == "most":
            return is_number(value) and (kind == "limits" or value >= 0.0)
        # What else is no number or no observation is refused where it is used.
        return key != "state" or value in range(len(self.states))

    def limits(self, claim: dict[str, Any], state: int, joint: str) -> list[tuple[Query, float]]:
        """Lists what a claim bounds, with the limit that each exceeds nowhere."""
        if claim["kind"] == "limits":
            low, high = self.robot.limits[joint]
            ends = (1, claim.get("most", high)), (-1, -claim.get("least", low))
            return [(Query("target", state, joint, sign), end) for sign, end in ends]
        of = "slope" if claim["kind"] == "never" else "effect"
        asked = Query(of, state, joint, -1 if claim["never"] == "falls" else 1)
        names = {re.sub(r"\.own$", f".{joint}", name) for name in claim["observations"]}
        box = self.box(claim["place"], state)
        moving = {name for name in names if of == "effect" or box[name][0] < box[name][1]}
        moving &= self.file.used(state, joint)
        return [(asked._replace(name=name), claim.get("most", 0.0)) for name in moving]

    def exceeds(self, claim: dict[str, Any], scope: list, points: list[Point]) -> bool:
        """Returns whether a witness breaks a limit; without one, whether a bound is missing."""
        for state, joint in scope:
            limits = self.limits(claim, state, joint)
            if points:
                broken = (self.reached(own, points) - ROUNDING > limit for own, limit in limits)
            else:
                # The targets must have values, also where no bound is needed.
                self.error(state, joint, claim["place"])
                bounds = (self.proved.get((*own, *claim["place"]), math.inf) for own, _ in limits)
                broken = (not own <= end for own, (_, end) in zip(bounds, limits, strict=True))
            if any(broken):
                return True
        return False

    def reached(self, asked: Query, points: list[Point]) -> arb:
        """Returns a lower bound of what is asked at a witness."""
        if asked.of == "slope":
            point: Box = {name: (value, value) for name, value in points[0].items()}
            return -self.bound(asked._replace(sign=-asked.sign), point)
        found = self.at(asked.state, asked.joint, points[0])
        if asked.of == "effect":
            name = str(asked.name)
            found -= self.at(asked.state, asked.joint, {**points[0], name: points[1][name]})
        return found.low if asked.sign > 0 else -found.high

    def lopsided(self, claim: dict[str, Any], scope: list, points: list[Point]) -> bool:
        """Returns whether a target differs from its image's at a witness, or else by its form."""
        mirror, place = self.file.mirror, claim["place"]
        if mirror is None:
            raise RefusedError(f"{claim['name']}: the gait has no mirror image")
        for state, joint in scope:
            image, turn = image_of(joint, mirror)
            theirs = mirror[state], image
            if points:
                apart = self.at(state, joint, points[0])
                other = self.at(*theirs, points[0], mirrored=True)
                apart = apart - other if turn > 0 else apart + other
                if apart.low > ROUNDING or -apart.high > ROUNDING:
                    return True
                continue
            # Both must have values in the box, the image also in the mirror image of the box.
            self.error(state, joint, place)
            self.error(*theirs, place)
            arithmetic = Rounding(self.robot, self.file.read(self.box(place, state)))
            arithmetic.target(self.file.evaluate(*theirs, arithmetic, mirrored=True), image)
            other = self.file.evaluate(*theirs, self.polynomials, mirrored=True) * turn
            if self.polynomial("target", state, joint) != other:
                return True
        return False

    def abrupt(self, claim: dict[str, Any], scope: list, points: list[Point]) -> bool:
        """Returns whether the action changes too much; without witnesses, whether it may."""
        # Look up by how much each observation may change.
        by, changes, place = {}, claim["changes"], claim["place"]
        for name in self.names:
            kind = name.partition(".")[0]
            by[name] = changes.get(name, 0.0 if kind == "cmd" else changes.get(kind, 0.0))
        if points:
            one, other = points
            near = all(abs(Fraction(one[k]) - Fraction(other[k])) <= Fraction(by[k]) for k in by)
            refuse_unless(near, f"{claim['name']}: its witnesses are further apart than it says")

        # Add up the squared change of each state's joints.
        squares = dict.fromkeys((state for state, _ in scope), arb(0))
        for state, joint in scope:
            if points:
                apart = self.at(state, joint, points[0]) - self.at(state, joint, points[1])
                moved = (apart.low.max(-apart.high) - ROUNDING).max(arb(0))
            else:
                moved = 2 * self.error(state, joint, place)
                box = self.box(place, state)
                for name in sorted(name for name in self.file.used(state, joint) if by[name]):
                    asked = [Query("slope", state, joint, sign, name) for sign in (1, -1)]
                    steepest = self.bound(asked[0], box).max(self.bound(asked[1], box))
                    moved += arb(by[name]) * steepest
            squares[state] += (moved / self.robot.action_scale) ** 2
        limit = claim.get("most", ABRUPT)
        return any(own > limit if points else not own <= limit for own in squares.values())


def check(certificate: Path, policy: Path | None = None, robot: Path | None = None) -> str:
    """Checks a certificate, and reports in a line what holds.

    By default the files of policy and robot are those that ship under the certificate's names.
    What does not hold, or cannot be read, raises a `RefusedError`.
    """
    unreadable = OSError, LookupError, TypeError, ValueError, ArithmeticError, AttributeError
    try:
        return Check(certificate, policy, robot).run()
    except (*unreadable, SyntaxError, RecursionError, MemoryError) as error:
        raise RefusedError(f"cannot be read ({type(error).__name__}: {error})") from error
