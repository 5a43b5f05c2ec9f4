"""Checks a certificate: its files, each bound, and each claim from bounds and witnesses that hold."""

import hashlib
import json
import math
import re
from dataclasses import replace
from fractions import Fraction
from itertools import product as ways
from pathlib import Path
from typing import Any, NamedTuple

from flint import arb

from .bounds import Polynomials, Ranged, Rounding
from .files import (
    RefusedError,
    is_number,
    read_bytes,
    read_json,
    read_yaml,
    refuse_unless,
)
from .policy import FormulaFile
from .robot import ABRUPT, COUNTED, DEFAULT_ROBOT, JOINTS, Box, Robot, image_of, is_robot_name

MODELS = Path(__file__).parents[2]
SHIPPED_CLAIMS = [MODELS / "certificates" / name for name in ("claims.yaml", "claims_imu.yaml")]

ROUNDING = 2e-9
"""More than two targets in double precision are away from exact ones (rad); a refutation must
exceed it."""

TOP = {"format", "gait", "states", "mirror", "policy", "boxes", "claims", "statements", "sha256"}
STATEMENT = {"of", "state", "joint", "sign", "box", "bound"}
BOXES, OUTCOMES = ("operating", "physical"), ("proved", "refuted", "undecided")
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

USUAL: dict[str, Any] = {"kind": None, "never": None, "box": "operating", "changes": {}}
USUAL |= {key: [] for key in ("joints", "states", "stuck", "observations")}
"""Keys of a claim besides its numbers, and the values that they have where they are left out."""

Point = dict[str, float]


class Query(NamedTuple):
    """A joint's target, its slope by a quantity or the effect of one, times a sign."""

    of: str
    state: int
    joint: str
    sign: int
    name: str | None = None


class Check:
    """A certificate, the robot and the policy that it is of, and what is proved of these.

    Attributes:
        proved: The least bound that holds of each query and place.
    """

    def __init__(self, certificate: Path, policy: Path | None, robot: Path | None) -> None:
        self.content = read_json(read_bytes(certificate))
        self.check_contents()
        self.robot = self.read_robot(robot)
        self.file = self.read_policy(policy)
        self.names, self.states = self.file.names, self.file.machine["states"]
        self.sensed = [name for name in self.names if not re.fullmatch(r"s\d+", name)]
        self.check_boxes()
        self.polynomials = Polynomials(self.names)
        self.targets: dict[tuple, Any] = {}
        self.errors: dict[tuple, arb] = {}
        self.proved: dict[tuple, float] = {}

    def check_contents(self) -> None:
        """Refuses other keys, a digest of other contents and another format."""
        content = self.content
        sound = isinstance(content, dict) and {*content} - {"robot"} == TOP
        refuse_unless(sound, "it is no certificate")
        rest = {key: value for key, value in content.items() if key != "sha256"}
        text = json.dumps(rest, sort_keys=True, separators=(",", ":"))
        same = hashlib.sha256(text.encode()).hexdigest() == content["sha256"]
        refuse_unless(same, "the certificate was changed: its digest is of other contents")
        of = content["format"]
        refuse_unless(type(of) is int and of == 1, "the certificate is of another format")

    def read_robot(self, given: Path | None) -> Robot:
        """Reads the file of the robot that the certificate names, and refuses that of another."""
        name = self.content.get("robot", DEFAULT_ROBOT)
        refuse_unless(is_robot_name(name), f"{str(name)[:60]!r} is no name of a robot")
        shipped = MODELS / "robots" / name / "robot.yaml"
        path = given or shipped
        found = given or shipped.is_file()
        refuse_unless(found, f"no robot {name!r} ships with the project; name its file by --robot")
        said = read_yaml(path)
        same = not shipped.is_file() or said == read_yaml(shipped)
        refuse_unless(same, f"{path} is not the {name} that ships; give your robot another name")
        robot = Robot.read(said, path)
        refuse_unless(robot.name == name, f"{path} is the file of another robot than the {name}")
        return robot

    def read_policy(self, given: Path | None) -> FormulaFile:
        """Reads the policy's file, and refuses another one than the certificate's."""
        content, own = self.content, self.content["policy"]
        gait, file = content["gait"], own["file"]
        if given is None:
            plain = all(re.fullmatch(r"\w+(\.formulas)?", part) for part in (gait, file))
            given = self.shipped("students", f"{gait}/{file}")
            refuse_unless(
                plain and given.is_file(),
                f"no policy {file!r} ships with the project; name its file by --policy",
            )
        data = read_bytes(given)
        same = hashlib.sha256(data).hexdigest() == own["sha256"]
        refuse_unless(same, f"the policy {given} is not the one that was certified")
        read = FormulaFile(data.decode("ascii"), content["mirror"])
        kind = "symbolic" if read.serves_every_state else "statewise_symbolic"
        refuse_unless(own["kind"] == kind, "the policy is of another kind")
        refuse_unless(read.header["gait"] == gait, "the policy is of another gait")
        refuse_unless(read.header["robot"] == self.robot.name, "the policy is of another robot")
        refuse_unless(read.machine["states"] == content["states"], "the policy has other states")
        if "gains" in read.header:
            stiffness = float(read.header["gains"].split()[0])
            refuse_unless(0.0 < stiffness <= 1000.0, "the policy's gains are none")
            self.robot = replace(self.robot, stiffness=stiffness)
        return read

    def shipped(self, folder: str, rest: str) -> Path:
        """Returns where a file of the robot ships; the default robot's are not apart."""
        own = [] if self.robot.name == DEFAULT_ROBOT else [self.robot.name]
        return MODELS.joinpath(folder, *own, rest)

    def check_boxes(self) -> None:
        """Refuses boxes that are not of the observations, or of what the robot can be."""
        boxes = self.content["boxes"]
        refuse_unless([*boxes] == [*BOXES], "there must be an operating and a physical box")
        for name, ends in [*boxes["operating"].items(), *boxes["physical"].items()]:
            sound = len(ends) == 2 and all(map(is_number, ends)) and ends[0] <= ends[1]
            refuse_unless(sound, f"the box of {name} is none")
        same = [*boxes["operating"]] == [*boxes["physical"]] == self.names
        refuse_unless(same, "the boxes are not of this policy's observations")
        for name, (low, high) in boxes["operating"].items():
            least, most = self.robot.physical(name, self.file.machine)
            expected, said = [min(low, least), max(high, most)], boxes["physical"][name]
            near = all(abs(a - b) <= 1e-9 for a, b in zip(expected, said, strict=True))
            refuse_unless(near, "the physical box is not what the robot and its sensors can be")
            boxes["physical"][name] = [min(expected[0], said[0]), max(expected[1], said[1])]
            whole = name not in COUNTED or (low == int(low) >= least and high == int(high) <= most)
            refuse_unless(whole, f"the operating box of {name} holds other counts than there are")

    def run(self) -> str:
        """Checks statements, then claims, and reports how many hold."""
        statements, claims = self.content["statements"], self.content["claims"]
        for statement in statements:
            self.check_statement(statement)
        outcomes = [self.check_claim(claim) for claim in claims]
        own = self.claims_of_its_own(claims)
        words = zip(OUTCOMES, ("proved", "refuted", "open"), strict=True)
        counts = [f"{outcomes.count(own)} {word}" for own, word in words]
        return (
            f"{len(statements)} bounds hold; claims: {', '.join(counts)}"
            f"{f' ({own} named by its author only)' if own else ''}; its operating box "
            f"{'is the one that ships' if self.box_ships() else 'is taken on trust'}"
        )

    def box_ships(self) -> bool:
        """Returns whether the operating box ships, and was measured with this machine."""
        gait = self.content["gait"]
        box = self.shipped("certificates/boxes", f"{gait}.yaml")
        machine = MODELS / "task" / "gaits" / f"{gait}.yaml"
        if not (re.fullmatch(r"\w+", gait) and box.is_file() and machine.is_file()):
            return False
        same = comparable(read_yaml(machine)) == comparable(self.file.machine)
        return same and read_yaml(box)["ranges"] == self.content["boxes"]["operating"]

    def claims_of_its_own(self, claims: list[dict[str, Any]]) -> int:
        """Counts claims that do not ship, and refuses one under the name of another that does."""
        names = [claim["name"] for claim in claims]
        refuse_unless(len({*names}) == len(names), "a claim stands twice")
        ships = {one["name"]: one for path in SHIPPED_CLAIMS for one in read_yaml(path)["claims"]}
        weakest = min(self.robot.effort.values()) / self.robot.stiffness
        for claim in claims:
            said = ships.get(claim["name"])
            if said is None:
                continue
            same = all(
                claim.get(key, usual) == said.get(key, usual) for key, usual in USUAL.items()
            )
            bounded = {"most", "least"} & {*claim} == ({"most"} if "limit" in said else set())
            within = said.get("limit") != "torque" or claim["most"] <= weakest + ROUNDING
            refuse_unless(
                same and bounded and within,
                f"{claim['name']}: says something else than the claim that ships by this name",
            )
        return sum(name not in ships for name in names)

    def box(self, where: str, stuck: list[str], state: int) -> Box:
        """Returns a box with the machine's state held."""
        boxes = self.content["boxes"]
        ranges = boxes[where] | {name: boxes["physical"][name] for name in stuck}
        box: Box = {name: (float(low), float(high)) for name, (low, high) in ranges.items()}
        held = {f"s{i}": float(i == state) for i in range(len(self.states))}
        return box | {name: (value, value) for name, value in held.items()}

    def error(self, state: int, joint: str, where: str, stuck: list[str]) -> arb:
        """Bounds what double precision does to a target over a box (rad)."""
        key = state, joint, where, *sorted(stuck)
        if key not in self.errors:
            arithmetic = Rounding(self.robot, self.file.read(self.box(where, stuck, state)))
            found = self.file.evaluate(state, joint, arithmetic)
            self.errors[key] = arithmetic.target(found, joint)
        return self.errors[key]

    def at(self, state: int, joint: str, point: Point, mirrored: bool = False) -> Ranged:
        """Returns a target at an observation, or at its image in the mirror."""
        box = self.file.read({name: (value, value) for name, value in point.items()})
        return self.file.evaluate(state, joint, Rounding(self.robot, box), mirrored)

    def polynomial(self, asked: Query) -> Any:
        """Returns a target, a slope or an effect, multiplied out when it is first asked for."""
        key = asked._replace(sign=1)
        if key not in self.targets:
            if asked.of == "target":
                found = self.file.evaluate(asked.state, asked.joint, self.polynomials)
            else:
                found = self.polynomial(Query("target", asked.state, asked.joint, 1))
            if asked.of == "slope":
                found = self.polynomials.slope(found, str(asked.name))
            if asked.of == "effect":
                other = self.polynomials.replacing(str(asked.name))
                found = found - self.file.evaluate(asked.state, asked.joint, other)
            self.targets[key] = found
        return self.targets[key] * asked.sign

    def bound(self, asked: Query, sensed: Box, splits: list | None = None) -> arb:
        """Bounds what is asked from above over a box, cell by cell of a tree of splits."""
        box, counted = self.file.read(sensed), {*COUNTED}
        if asked.name is not None:
            box["other"] = box[asked.name]
            counted |= {"other"} if asked.name in COUNTED else set()
        bound = self.polynomials.greatest(self.polynomial(asked), box, splits or [], counted)
        if asked.of == "slope":
            # A quantity that is beyond the range of its reading moves nothing.
            low, high = self.file.readings.get(str(asked.name), (-math.inf, math.inf))
            first, last = sensed[str(asked.name)]
            if last < low or first > high:
                return arb(0)
            return bound.max(arb(0)) if first < low or last > high else bound
        return bound

    def check_statement(self, own: dict[str, Any]) -> None:
        """Checks a bound, and keeps it."""
        known = STATEMENT <= {*own} <= STATEMENT | {"observation", "stuck", "splits"}
        refuse_unless(known, f"a statement has other keys: {sorted(own)}")
        name, where, stuck = own.get("observation"), own["box"], own.get("stuck", [])
        asked = Query(own["of"], own["state"], own["joint"], own["sign"], name)
        what = f"{asked.of} of {asked.joint} in state {asked.state}"
        refuse_unless(type(asked.state) is int and type(asked.sign) is int, f"{what}: is none")
        there = asked.state in range(len(self.states)) and asked.joint in JOINTS
        refuse_unless(there and asked.sign in (1, -1) and where in BOXES, f"{what}: is none")
        needs_name = {"target": False, "slope": True, "effect": True}
        refuse_unless(asked.of in needs_name, f"{what}: is not known")
        observed = name in self.sensed if needs_name[asked.of] else name is None
        refuse_unless(observed, f"{what}: of no observation")
        counts = asked.of == "slope" and name in COUNTED
        refuse_unless(not counts, f"{what}: {name} counts steps, and has no slope")
        refuse_unless(is_list_of(stuck, self.sensed), f"{what}: what is stuck is no observation")
        refuse_unless(is_number(own["bound"]), f"{what}: its bound is no number")

        # A slope is one of the exact target, from which no computed one is further than its error.
        error = self.error(asked.state, asked.joint, where, stuck)
        error *= {"target": 1, "slope": 0, "effect": 2}[asked.of]
        box = self.box(where, stuck, asked.state)
        bound = self.bound(asked, box, own.get("splits", [])) + error
        refuse_unless(bound <= own["bound"], f"{what}: the bound {own['bound']} is not proved")
        key = *asked, where, *sorted(stuck)
        self.proved[key] = min(own["bound"], self.proved.get(key, math.inf))

    def check_claim(self, claim: dict[str, Any]) -> str:
        """Decides a claim again, from bounds that hold or from its witnesses."""
        check_keys(claim, self.states, self.sensed)
        kind, outcome, points = claim["kind"], claim["outcome"], claim["witnesses"]
        states = [self.states.index(one) for one in claim.get("states", [])]
        scope = [*ways(states or range(len(self.states)), claim.get("joints") or JOINTS)]
        for point in points:
            state = next((i for i in range(len(self.states)) if point.get(f"s{i}") == 1.0), -1)
            box = self.box(claim.get("box", "operating"), claim.get("stuck", []), max(state, 0))
            inside = [*point] == self.names and all(
                low <= point[name] <= high for name, (low, high) in box.items()
            )
            whole = inside and all(point[name] == int(point[name]) for name in COUNTED)
            refuse_unless(whole, f"{claim['name']}: its witness is not where the claim is made")
            scope = [place for place in scope if place[0] == state]
        needed = {"effect": 2, "change": 2}.get(kind, 1) if outcome == "refuted" else 0
        refuse_unless(len(points) == needed, f"{claim['name']}: has another number of witnesses")
        decide = {"mirror": self.lopsided, "change": self.abrupt}.get(kind, self.exceeds)
        if outcome != "undecided":
            right = decide(claim, scope, points) == (outcome == "refuted")
            refuse_unless(right, f"{claim['name']}: is not {outcome}")
        return outcome

    def limits(self, claim: dict[str, Any], state: int, joint: str) -> list[tuple[Query, float]]:
        """Lists what a claim bounds, with the limit that each exceeds nowhere."""
        if claim["kind"] == "limits":
            low, high = self.robot.limits[joint]
            ends = (1, claim.get("most", high)), (-1, -claim.get("least", low))
            return [(Query("target", state, joint, sign), end) for sign, end in ends]
        of = "slope" if claim["kind"] == "never" else "effect"
        asked = Query(of, state, joint, -1 if claim.get("never") == "falls" else 1)
        names = [re.sub(r"\.own$", f".{joint}", name) for name in claim["observations"]]
        box = self.box(claim.get("box", "operating"), claim.get("stuck", []), state)
        moving = self.file.used(state, joint) & {
            name for name in names if of == "effect" or box[name][0] < box[name][1]
        }
        return [(asked._replace(name=name), claim.get("most", 0.0)) for name in moving]

    def exceeds(self, claim: dict[str, Any], scope: list, points: list[Point]) -> bool:
        """Returns whether a witness breaks a limit; without one, whether a bound is missing."""
        where, stuck = claim.get("box", "operating"), claim.get("stuck", [])
        for state, joint in scope:
            if not points:
                # The targets must have values, also where no bound is needed.
                self.error(state, joint, where, stuck)
            for asked, limit in self.limits(claim, state, joint):
                key = *asked, where, *sorted(stuck)
                if not points and not self.proved.get(key, math.inf) <= limit:
                    return True
                if points and self.reached(asked, points) - ROUNDING > limit:
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
        """Returns whether a target differs from that of its image; without a witness, by its form."""
        image, where = self.file.mirror, claim.get("box", "operating")
        refuse_unless(image is not None, f"{claim['name']}: the gait has no mirror image")
        for state, joint in scope:
            theirs, turn = image_of(joint, image)
            if points:
                own = self.at(state, joint, points[0])
                other = self.at(image[state], theirs, points[0], mirrored=True)
                apart = own - other if turn > 0 else own + other
                if apart.low > ROUNDING or -apart.high > ROUNDING:
                    return True
                continue
            # Both must have values in the box, the image also in the mirror image of the box.
            self.error(state, joint, where, [])
            self.error(image[state], theirs, where, [])
            arithmetic = Rounding(self.robot, self.file.read(self.box(where, [], state)))
            seen = self.file.evaluate(image[state], theirs, arithmetic, mirrored=True)
            arithmetic.target(seen, theirs)
            own = self.polynomial(Query("target", state, joint, 1))
            if own != turn * self.file.evaluate(image[state], theirs, self.polynomials, True):
                return True
        return False

    def abrupt(self, claim: dict[str, Any], scope: list, points: list[Point]) -> bool:
        """Returns whether the action changes too much; without witnesses, whether it may."""
        by, where = {}, claim.get("box", "operating")
        for name in self.names:
            kind = name.partition(".")[0]
            usual = 0.0 if kind == "cmd" else claim["changes"].get(kind, 0.0)
            by[name] = claim["changes"].get(name, usual)
        if points:
            one, other = points
            near = all(abs(Fraction(one[k]) - Fraction(other[k])) <= Fraction(by[k]) for k in by)
            refuse_unless(near, f"{claim['name']}: its witnesses are further apart than it says")
        squares = dict.fromkeys((state for state, _ in scope), arb(0))
        for state, joint in scope:
            if points:
                apart = self.at(state, joint, points[0]) - self.at(state, joint, points[1])
                moved = apart.low.max(-apart.high).max(arb(0)) - ROUNDING
                moved = moved.max(arb(0))
            else:
                box, moved = self.box(where, [], state), 2 * self.error(state, joint, where, [])
                for name in sorted(self.file.used(state, joint)):
                    if by[name]:
                        slope = Query("slope", state, joint, 1, name)
                        steepest = self.bound(slope, box).max(
                            self.bound(slope._replace(sign=-1), box)
                        )
                        moved += arb(by[name]) * steepest
            squares[state] += (moved / self.robot.action_scale) ** 2
        limit = claim.get("most", ABRUPT)
        return any(own > limit if points else not own <= limit for own in squares.values())


def comparable(machine: dict[str, Any]) -> Any:
    """Returns a machine without its description, and its conditions without spaces."""
    rest = {key: value for key, value in machine.items() if key != "description"}
    edges = [{**edge, "when": edge["when"].replace(" ", "")} for edge in machine["transitions"]]
    return {**rest, "transitions": edges}


def is_list_of(value: Any, known: list[str]) -> bool:
    """Returns whether a value lists known names, none of them twice."""
    texts = isinstance(value, list) and all(isinstance(own, str) for own in value)
    return texts and {*value} <= {*known} and len({*value}) == len(value)


def check_keys(claim: Any, states: list[str], names: list[str]) -> None:
    """Refuses a claim with a key that is unknown, missing, of no use or of another kind.

    Args:
        claim: The claim.
        states: Names of the machine's states.
        names: The quantities; of the machine's states nothing can be claimed, since each state is
            decided separately.
    """
    refuse_unless(isinstance(claim, dict), "a claim is no mapping")
    name, kind = repr(claim.get("name"))[:60], claim.get("kind")
    refuse_unless(kind in KINDS, f"{name}: a claim of kind {kind!r} is not known")
    must, may = KINDS[kind]
    known = WRITTEN | must <= {*claim} <= WRITTEN | must | SCOPE | may
    refuse_unless(known, f"{name}: has other keys than a claim of kind {kind!r}")
    kinds = {name.partition(".")[0] for name in names} - {"cmd"}
    of_joints = [*names, "q.own", "dq.own", "a.own"]

    def sound(key: str, value: Any) -> bool:
        match key:
            case "worst" | "claimed" | "least":
                return is_number(value)
            case "most":
                return is_number(value) and (kind == "limits" or value >= 0.0)
            case "name" | "where" | "kind":
                return isinstance(value, str) and bool(value or key == "where")
            case "outcome" | "box" | "never":
                return (
                    value in {"outcome": OUTCOMES, "box": BOXES, "never": ("rises", "falls")}[key]
                )
            case "joints" | "states" | "stuck":
                return is_list_of(value, {"joints": JOINTS, "states": states, "stuck": names}[key])
            case "observations":
                counted = kind == "never" and isinstance(value, list) and {*COUNTED} & {*value}
                return bool(value) and is_list_of(value, of_joints) and not counted
            case "witnesses":
                points = isinstance(value, list) and all(isinstance(one, dict) for one in value)
                return points and all(is_number(own) for one in value for own in one.values())
        changes = isinstance(value, dict) and {*value} <= {*names, *kinds}
        return changes and bool(value) and all(is_number(o) and o >= 0.0 for o in value.values())

    for key, value in claim.items():
        refuse_unless(sound(key, value), f"{name}: its {key!r} is not what it must be")


def check(certificate: Path, policy: Path | None = None, robot: Path | None = None) -> str:
    """Checks a certificate, and reports in a line what holds.

    Args:
        certificate: The certificate.
        policy: The policy's file; by default the student that ships under the certificate's name.
        robot: The robot's file, in the same way.

    Raises:
        RefusedError: if anything in it does not hold, or it cannot be read.
    """
    try:
        return Check(certificate, policy, robot).run()
    except (OSError, LookupError, TypeError, ValueError, ArithmeticError, AttributeError) as error:
        raise RefusedError(f"cannot be read ({type(error).__name__}: {error})") from error
    except (RecursionError, MemoryError) as error:
        raise RefusedError(f"cannot be read ({type(error).__name__}: {error})") from error
