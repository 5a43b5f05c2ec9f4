"""Checks a certificate: each claim by bounds of formulas, or by observations that break it.

The caller has checked the form of the claims, and the certificate's assumptions about the robot,
its boxes and its mirror.
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
"""Greatest accepted error of a target in double precision, and least excess of a witness over its
limit, which is at least the error of two targets (rad)."""

DECIDED = {"outcome", "splits", "witnesses"}  # keys of the decision, not of the claim

Claim = dict[str, Any]


class Decision(NamedTuple):
    """A checked claim and its outcome; `foreign` is true for claims that do not ship."""

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
            valid = name not in COUNTED or (low == int(low) and high == int(high))
            refuse_unless(valid and least <= low <= high <= most, f"the box of {name} is invalid")
        self.sensed = {name for name in self.operating if not re.fullmatch(r"s\d+", name)}

        # The policy must be the certified one; its file may omit the mirror.
        data = read_bytes(policy)
        same = hashlib.sha256(data).hexdigest() == content["policy"]["sha256"]
        refuse_unless(same, f"the policy {policy} is not the one that was certified")
        self.file = FormulaFile(data.decode("ascii"), [*self.operating])
        self.numbers = content["numbers"]
        same = self.file.mirror in (None, content["mirror"])
        refuse_unless(same, "its mirror is not that of the policy")
        self.file.mirror = content["mirror"]
        self.polynomials = Polynomials([*self.operating])
        self.target = cache(partial(self.file.evaluate, self.polynomials))

    def decisions(self, claims: list[Claim]) -> Iterator[Decision]:
        """Decides every claim again."""
        listed = [item for path in SHIPPED for item in yaml.safe_load(path.read_text())["claims"]]
        shipped = {claim["name"]: claim for claim in listed}
        refuse_unless(claims, "it has no claims, and so proves nothing")
        names = {claim["name"] for claim in claims}
        refuse_unless(len(names) == len(claims), "two claims have the same name")
        for claim in claims:
            name, content = claim["name"], {key: claim[key] for key in claim if key not in DECIDED}
            same = shipped.get(name, content) == content
            refuse_unless(same, f"{name}: the claim of this name that ships is another one")
            self.decide(claim, name)
            yield Decision(claim["outcome"], content, self.most(claim), name not in shipped)

    def decide(self, claim: Claim, name: str) -> None:
        """Refuses a claim whose outcome is not the stated one."""
        # It must be about known observations.
        kinds = {symbol.partition(".")[0] for symbol in self.sensed} - {"cmd"}
        named = {*claim.get("stuck", []), *claim.get("changes", [])}
        refuse_unless(named <= self.sensed | kinds, f"{name}: names what is not observed")

        # Its witnesses must be in its box, in one of its states.
        points, outcome = claim.get("witnesses", []), claim["outcome"]
        states = {self.file.states.index(state) for state in claim.get("states", self.file.states)}
        needed = 2 if claim["kind"] in ("effect", "change") else 1
        needed = {"proved": 0, "refuted": needed, "undecided": 0}[outcome]
        refuse_unless(len(points) == needed, f"{name}: has a wrong number of witnesses")
        if points:
            states = {state for state in states if self.holds(claim, state)}
            refuse_unless(states, f"{name}: its witness is outside its box or its states")

        # If it is proved, no bound exceeds its limit; if it is refuted, a witness does.
        if outcome != "undecided":
            excesses = dict(item for state in states for item in self.excesses(claim, state))
            refuse_unless({*claim.get("splits", [])} <= {*excesses}, f"{name}: has other splits")
            exceeds = [value > 0 if points else not value <= 0 for value in excesses.values()]
            refuse_unless(any(exceeds) == bool(points), f"{name}: is not {outcome}")

    def most(self, claim: Claim) -> float:
        """Returns the limit of a claim: a number in the claim, or one that the robot determines."""
        if "limit" in claim:
            return self.numbers[claim["limit"]] / self.numbers["stiffness"]
        return claim.get("most", 0.0)

    def box(self, claim: Claim, state: int) -> Box:
        """Returns the box of a claim with the machine's state fixed."""
        boxes = {"operating": self.operating, "physical": self.physical}
        box = boxes[claim.get("box", "operating")]
        box = box | {name: self.physical[name] for name in claim.get("stuck", [])}
        one_hot = {f"s{i}": (float(i == state),) * 2 for i in range(len(self.file.states))}
        return {name: (low, high) for name, (low, high) in (box | one_hot).items()}

    def holds(self, claim: Claim, state: int) -> bool:
        """Returns whether a claim's witnesses are in its box and in a state."""
        box = self.box(claim, state)
        for point in claim["witnesses"]:
            within = all(low <= point[name] <= high for name, (low, high) in box.items())
            are_whole = all(point[name] == int(point[name]) for name in COUNTED)
            if not (within and are_whole and [*point] == [*box]):
                return False
        return True

    def excesses(self, claim: Claim, state: int) -> Iterator[tuple[str, arb]]:
        """Yields the excess over each limit: an upper bound over the box, or that at witnesses."""
        box, is_slope = self.box(claim, state), claim["kind"] == "never"
        witnesses = claim.get("witnesses", [])
        points = [{name: (at, at) for name, at in point.items()} for point in witnesses]
        if claim["kind"] == "change":
            yield f"{state}", self.squared_change(claim, box, state, points) - self.most(claim)
            return
        places = points or [box]
        for joint in {*claim.get("joints", JOINTS)}:
            for name, formula, limit, error in self.bounds(claim, box, joint, state):
                key = f"{joint} {state} {name}"
                splits = claim.get("splits", {}).get(key, [])
                greatest = self.greatest(formula, places[0], places[-1], name, is_slope, splits)
                yield key, greatest - limit + (-ROUNDING if points else error)

    def bounds(self, claim: Claim, box: Box, joint: str, state: int) -> Iterator[tuple]:
        """Yields the name, formula, limit and error of each bound of a claim on a joint."""
        error, used = self.rounding(box, joint, state)
        target, most = self.target(joint, state), self.most(claim)
        names = {re.sub(r"\.own$", f".{joint}", name) for name in claim.get("observations", [])}
        known = self.sensed - {*COUNTED} if claim["kind"] == "never" else self.sensed
        refuse_unless(names <= known, f"{claim['name']}: names what has no value, or no slope")
        match claim["kind"]:
            case "limits":
                yield "most", target, most, error
                yield "least", -target, -claim["least"], error
            case "mirror":
                # The image must have values, too, for these observations and for mirrored ones.
                self.rounding(box, joint, state, image=True)
                other, image = image_of(joint, self.file.mirror)[0], self.file.mirror[state]
                self.rounding(self.box(claim, image), other, image)
                difference = target - self.image(self.polynomials, joint, state)
                yield "most", difference, 0.0, arb(0)
                yield "least", -difference, 0.0, arb(0)
            case "effect":
                for name in names & used:
                    moved = self.file.evaluate(self.polynomials.moving(name), joint, state)
                    yield name, target - moved, most, 2 * error
            case "never":
                # A slope is that of the exact target, to which computed targets are close.
                sign = {"rises": 1, "falls": -1}[claim["never"]]
                for name in names & used:
                    if box[name][0] < box[name][1]:
                        yield name, sign * self.polynomials.slope(target, name), most, arb(0)
            case kind:
                raise ValueError(f"a claim of kind {kind!r} is not known")

    def squared_change(self, claim: Claim, box: Box, state: int, points: list[Box]) -> arb:
        """Bounds the squared change of the action: from above in a box, from below at witnesses."""
        # Look up the greatest change of each observation.
        changes = claim["changes"]
        changes = {name: changes.get(name, changes.get(name.partition(".")[0], 0)) for name in box}
        for name in changes if points else ():
            first, second = (Fraction(point[name]) for point in claim["witnesses"])
            near = abs(first - second) <= Fraction(changes[name])
            refuse_unless(near, f"{claim['name']}: its witnesses are further apart than it says")

        squared = arb(0)
        for joint in {*claim.get("joints", JOINTS)}:
            error, used = self.rounding(box, joint, state)
            target = self.target(joint, state)
            if points:
                first, second = (self.greatest(target, at, at, "", False) for at in points)
                change = (abs(first - second) - ROUNDING).max(arb(0))
            else:
                change = 2 * error
                for name in sorted(name for name in used if changes[name]):
                    slope = self.polynomials.slope(target, name)
                    steepest = [self.greatest(s, box, box, name, True) for s in (slope, -slope)]
                    change += arb(changes[name]) * reduce(arb.max, steepest)
            squared += (change / self.numbers["action_scale"]) ** 2
        return squared

    def greatest(
        self, formula: Any, sensed: Box, other: Box, name: str, is_slope: bool, splits: Any = ()
    ) -> arb:
        """Bounds a formula from above; the "other" value of quantity `name` is in box `other`."""
        box, counted = self.file.read(sensed), COUNTED
        if name in box:
            box["other"] = self.file.read(other)[name]
            counted = (*COUNTED, "other") if name in COUNTED else COUNTED
        bound = self.polynomials.greatest(formula, box, splits, counted)
        if not is_slope or box[name] == sensed[name]:
            return bound
        # A quantity beyond the range of its reading has no effect.
        return bound.max(arb(0)) if box[name][0] < box[name][1] else arb(0)

    def image(self, algebra: Any, joint: str, state: int) -> Any:
        """Evaluates a target by the formula of its mirror image."""
        mirror = self.file.mirror
        refuse_unless(mirror, "a claim is about the mirror, but the gait has no mirror image")
        other, sign = image_of(joint, mirror)
        target = self.file.evaluate(algebra, other, mirror[state], mirrored=True)
        return target if sign > 0 else -target

    def rounding(
        self, box: Box, joint: str, state: int, image: bool = False
    ) -> tuple[arb, set[str]]:
        """Bounds the error of a target in double precision (rad), and returns its quantities."""
        algebra = DoublePrecision(self.file.read(box))
        target = (self.image if image else self.file.evaluate)(algebra, joint, state)
        # A policy returns an action, which the robot converts back to the target.
        error = target.error + 4 * UNIT * (target.value + target.error + STANCE)
        accepted = error.abs_upper() <= LARGEST_ERROR
        refuse_unless(accepted, f"a target of {joint} may be off by too much in double precision")
        return arb(error.abs_upper()), algebra.used


def check(certificate: Path, policy: Path) -> list[Decision]:
    """Checks a certificate of a policy, and returns its decided claims.

    Raises a `RefusedError` if a claim does not hold or a file cannot be read.
    """
    unreadable = OSError, LookupError, TypeError, ValueError, ArithmeticError, AttributeError
    try:
        content = read_json(certificate)
        return [*Check(content, policy).decisions(content["claims"])]
    except (*unreadable, SyntaxError, RecursionError, MemoryError) as error:
        raise RefusedError(f"cannot be read ({type(error).__name__}: {error})") from error
