"""Checks a certificate: each claim by bounds of formulas, or by observations that break it.

Whoever calls it has asked that claims are written as they must be, and that what a certificate
assumes of the robot, its boxes and its mirror is so.
"""

import hashlib
import re
from collections.abc import Iterator
from fractions import Fraction
from functools import cache, partial, reduce
from pathlib import Path
from typing import Any, NamedTuple

import yaml
from flint import arb

from .bounds import STANCE, UNIT, DoublePrecision, Polynomials
from .files import RefusedError, read_bytes, read_json, refuse_unless
from .policy import JOINTS, Box, FormulaFile, image_of

SHIPPED = [Path(__file__).parents[1] / name for name in ("claims.yaml", "claims_imu.yaml")]

COUNTED = ("t", "cmd.t")
LARGEST_ERROR, ROUNDING = 1e-9, 2e-9
"""Error of a target in double precision beyond which nothing is certified, and by how much a
refutation must exceed its limit: more than the errors of two targets (rad)."""

DECIDED = {"outcome", "splits", "witnesses"}  # how a claim was decided, not what it claims

Claim = dict[str, Any]


class Decision(NamedTuple):
    """A checked claim and its outcome; `foreign` claims do not ship."""

    outcome: str
    claim: Claim
    most: float
    foreign: bool


class Check:
    """A certificate and its policy."""

    def __init__(self, content: dict[str, Any], policy: Path) -> None:
        # The operating box must be in the physical one, its counts whole.
        self.operating, self.physical = content["operating"], content["physical"]
        for name, (low, high) in self.operating.items():
            least, most = self.physical[name]
            whole = name not in COUNTED or (low == int(low) and high == int(high))
            refuse_unless(least <= low <= high <= most and whole, f"the box of {name} is none")
        self.sensed = {name for name in self.operating if not re.fullmatch(r"s\d+", name)}

        # The policy must be its policy, which may leave its mirror out.
        data = read_bytes(policy)
        same = hashlib.sha256(data).hexdigest() == content["policy"]["sha256"]
        refuse_unless(same, f"the policy {policy} is not the one that was certified")
        self.file, self.numbers = (
            FormulaFile(data.decode("ascii"), [*self.operating]),
            content["numbers"],
        )
        same = self.file.mirror in (None, content["mirror"])
        refuse_unless(same, "its mirror is not that of the policy")
        self.file.mirror = content["mirror"]
        self.polynomials = Polynomials([*self.operating])
        self.target = cache(partial(self.file.evaluate, self.polynomials))

    def decisions(self, claims: list[Claim]) -> Iterator[Decision]:
        """Decides every claim again."""
        listed = [one for path in SHIPPED for one in yaml.safe_load(path.read_text())["claims"]]
        ships = {claim["name"]: claim for claim in listed}
        refuse_unless(claims, "it holds no claims, and so proves nothing")
        refuse_unless(len({own["name"] for own in claims}) == len(claims), "a claim stands twice")
        for claim in claims:
            what, said = claim["name"], {key: claim[key] for key in claim if key not in DECIDED}
            same = ships.get(what, said) == said
            refuse_unless(same, f"{what}: the claim that ships by this name says otherwise")
            self.decide(claim, what)
            yield Decision(claim["outcome"], said, self.most(claim), what not in ships)

    def decide(self, claim: Claim, what: str) -> None:
        """Refuses a claim that is not what it is said to be."""
        # It must be of what is observed.
        kinds = {name.partition(".")[0] for name in self.sensed} - {"cmd"}
        named = {*claim.get("stuck", []), *claim.get("changes", [])}
        refuse_unless(named <= self.sensed | kinds, f"{what}: names what is not observed")

        # Its witnesses must be in its box, in one of its states.
        points, outcome = claim.get("witnesses", []), claim["outcome"]
        states = {self.file.states.index(own) for own in claim.get("states", self.file.states)}
        needed = 2 if claim["kind"] in ("effect", "change") else 1
        needed = {"proved": 0, "refuted": needed, "undecided": 0}[outcome]
        refuse_unless(len(points) == needed, f"{what}: has another number of witnesses")
        if points:
            states = {own for own in states if self.holds(claim, own)}
            refuse_unless(states, f"{what}: its witness is not where the claim is made")

        # No bound may exceed its limit, or a witness must.
        if outcome != "undecided":
            found = {key: own for state in states for key, own in self.excesses(claim, state)}
            refuse_unless({*claim.get("splits", [])} <= {*found}, f"{what}: has other splits")
            exceeds = [own > 0 if points else not own <= 0 for own in found.values()]
            refuse_unless(any(exceeds) == bool(points), f"{what}: is not {outcome}")

    def most(self, claim: Claim) -> float:
        """Returns the number of a claim, which may be one of the robot's."""
        if "limit" in claim:
            return self.numbers[claim["limit"]] / self.numbers["stiffness"]
        return claim.get("most", 0.0)

    def box(self, claim: Claim, state: int) -> Box:
        """Returns the box of a claim, with the machine's state held."""
        boxes = {"operating": self.operating, "physical": self.physical}
        whole = boxes[claim.get("box", "operating")]
        whole = whole | {name: self.physical[name] for name in claim.get("stuck", [])}
        held = {f"s{i}": (float(i == state),) * 2 for i in range(len(self.file.states))}
        return {name: (low, high) for name, (low, high) in (whole | held).items()}

    def holds(self, claim: Claim, state: int) -> bool:
        """Returns whether a claim's witnesses are in its box and in a state."""
        box = self.box(claim, state)
        for point in claim["witnesses"]:
            within = all(low <= point[name] <= high for name, (low, high) in box.items())
            whole = all(point[name] == int(point[name]) for name in COUNTED)
            if not (within and whole and [*point] == [*box]):
                return False
        return True

    def excesses(self, claim: Claim, state: int) -> Iterator[tuple[str, arb]]:
        """Yields by how much limits are exceeded: at most in a box, or at witnesses."""
        box, is_slope = self.box(claim, state), claim["kind"] == "never"
        points = [
            {name: (at, at) for name, at in own.items()} for own in claim.get("witnesses", [])
        ]
        if claim["kind"] == "change":
            yield f"{state}", self.squared_change(claim, box, state, points) - self.most(claim)
            return
        places = points or [box]
        for joint in {*claim.get("joints", JOINTS)}:
            for name, formula, limit, error in self.bounds(claim, box, joint, state):
                key = f"{joint} {state} {name}"
                splits = claim.get("splits", {}).get(key, [])
                found = self.greatest(formula, places[0], places[-1], name, is_slope, splits)
                yield key, found - limit + (-ROUNDING if points else error)

    def bounds(self, claim: Claim, box: Box, joint: str, state: int) -> Iterator[tuple]:
        """Yields what a claim bounds of a joint: a name, a formula, its limit and its error."""
        error, used = self.rounding(box, joint, state)
        target, most = self.target(joint, state), self.most(claim)
        names = {re.sub(r"\.own$", f".{joint}", own) for own in claim.get("observations", [])}
        known = self.sensed - {*COUNTED} if claim["kind"] == "never" else self.sensed
        refuse_unless(names <= known, f"{claim['name']}: names what has no value, or no slope")
        match claim["kind"]:
            case "limits":
                yield "most", target, most, error
                yield "least", -target, -claim["least"], error
            case "mirror":
                # The image must have values, too: of such observations, and of what they look like.
                self.rounding(box, joint, state, image=True)
                other, theirs = image_of(joint, self.file.mirror)[0], self.file.mirror[state]
                self.rounding(self.box(claim, theirs), other, theirs)
                apart = target - self.image(self.polynomials, joint, state)
                yield "most", apart, 0.0, arb(0)
                yield "least", -apart, 0.0, arb(0)
            case "effect":
                for name in names & used:
                    moved = self.file.evaluate(self.polynomials.moving(name), joint, state)
                    yield name, target - moved, most, 2 * error
            case "never":
                # A slope is one of the exact target, close to which computed ones are.
                sign = {"rises": 1, "falls": -1}[claim["never"]]
                for name in names & used:
                    if box[name][0] < box[name][1]:
                        yield name, sign * self.polynomials.slope(target, name), most, arb(0)
            case other:
                raise ValueError(f"a claim of kind {other!r} is not known")

    def squared_change(self, claim: Claim, box: Box, state: int, points: list[Box]) -> arb:
        """Bounds the squared change of the action, from above or at two witnesses."""
        # Look up by how much each observation may change.
        changes = claim["changes"]
        by = {own: changes.get(own, changes.get(own.partition(".")[0], 0.0)) for own in box}
        for name in by if points else ():
            one, other = (Fraction(point[name]) for point in claim["witnesses"])
            near = abs(one - other) <= Fraction(by[name])
            refuse_unless(near, f"{claim['name']}: its witnesses are further apart than it says")

        squared = arb(0)
        for joint in {*claim.get("joints", JOINTS)}:
            error, used = self.rounding(box, joint, state)
            target = self.target(joint, state)
            if points:
                one, other = (self.greatest(target, at, at, "", False) for at in points)
                moved = (abs(one - other) - ROUNDING).max(arb(0))
            else:
                moved = 2 * error
                for name in sorted(name for name in used if by[name]):
                    slope = self.polynomials.slope(target, name)
                    ends = (self.greatest(own, box, box, name, True) for own in (slope, -slope))
                    moved += arb(by[name]) * reduce(arb.max, ends)
            squared += (moved / self.numbers["action_scale"]) ** 2
        return squared

    def greatest(
        self, formula: Any, sensed: Box, other: Box, name: str, is_slope: bool, splits: Any = ()
    ) -> arb:
        """Bounds a formula, in which a quantity may be moved to another box, from above."""
        box, counted = self.file.read(sensed), COUNTED
        if name in box:
            box["other"] = self.file.read(other)[name]
            counted = (*COUNTED, "other") if name in COUNTED else COUNTED
        found = self.polynomials.greatest(formula, box, splits, counted)
        if not is_slope or box[name] == sensed[name]:
            return found
        # A quantity that is beyond the range of its reading moves nothing.
        return found.max(arb(0)) if box[name][0] < box[name][1] else arb(0)

    def image(self, algebra: Any, joint: str, state: int) -> Any:
        """Works out what the mirror image of a target says of the target."""
        mirror = self.file.mirror
        refuse_unless(mirror, "a claim is of the mirror, and the gait has no mirror image")
        other, sign = image_of(joint, mirror)
        found = self.file.evaluate(algebra, other, mirror[state], mirrored=True)
        return found if sign > 0 else -found

    def rounding(
        self, box: Box, joint: str, state: int, image: bool = False
    ) -> tuple[arb, set[str]]:
        """Bounds what double precision does to a target (rad), and names what it is made of."""
        algebra = DoublePrecision(self.file.read(box))
        found = (self.image if image else self.file.evaluate)(algebra, joint, state)
        # A policy returns the target as an action.
        error = found.error + 4 * UNIT * (found.value + found.error + STANCE)
        accepted = error.abs_upper() <= LARGEST_ERROR
        refuse_unless(accepted, f"a target of {joint} may be off by too much in double precision")
        return arb(error.abs_upper()), algebra.used


def check(certificate: Path, policy: Path) -> list[Decision]:
    """Checks a certificate of a policy, and returns what holds.

    What does not hold, or cannot be read, raises a `RefusedError`.
    """
    unreadable = OSError, LookupError, TypeError, ValueError, ArithmeticError, AttributeError
    try:
        content = read_json(certificate)
        return [*Check(content, policy).decisions(content["claims"])]
    except (*unreadable, SyntaxError, RecursionError, MemoryError) as error:
        raise RefusedError(f"cannot be read ({type(error).__name__}: {error})") from error
