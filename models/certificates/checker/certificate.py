"""A certificate's statements, each bound checked anew, and its claims, decided from what holds."""

import math
from fractions import Fraction
from itertools import product as ways
from pathlib import Path
from typing import Any

import yaml

from .document import BOXES, MODELS, OUTCOMES, Document, check_keys, observations
from .robot import (
    ABRUPT,
    COUNTED,
    JOINTS,
    BoundQuery,
    Box,
    RefusedError,
    image_of,
    is_number,
    read_yaml,
    refuse_unless,
)

ROUNDING = 2e-9
"""More than two targets in double precision are away from exact ones (rad); a refutation must
exceed it."""

SHIPPED_CLAIMS = tuple(
    MODELS / "certificates" / name for name in ("claims.yaml", "claims_imu.yaml")
)

SAYS = {
    **dict.fromkeys(("kind", "keeps", "never")),
    **{key: [] for key in ("joints", "states", "stuck", "observations")},
    "box": "operating",
    "changes": {},
}
"""What a claim says besides its numbers, and what it says where a key is left out."""

STATEMENT = ("of", "state", "joint", "sign", "box", "bound")

Point = dict[str, float]


class Check(Document):
    """Checks the statements and the claims of a document.

    Attributes:
        proved: The least bound that holds of each question and place.
    """

    def __init__(
        self, certificate: Path, policy: Path | None, gait: Path | None, robot: Path | None
    ) -> None:
        super().__init__(certificate, policy, gait, robot)
        self.proved: dict[tuple, float] = {}
        self.rounding: dict[tuple, Any] = {}

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
            f"{f' ({own} named by its author alone)' if own else ''}; its operating box "
            f"{'is the one that ships' if self.box_ships() else 'is its own, taken on trust'}"
        )

    def claims_of_its_own(self, claims: list[dict[str, Any]]) -> int:
        """Counts claims that do not ship, and refuses one under the name of another that does."""
        names = [claim["name"] for claim in claims]
        refuse_unless(len({*names}) == len(names), "a claim stands twice")
        ships = {one["name"]: one for path in SHIPPED_CLAIMS for one in read_yaml(path)["claims"]}
        for claim in claims:
            said = ships.get(claim["name"], {})
            same = all(claim.get(key, usual) == said.get(key, usual) for key, usual in SAYS.items())
            bounded = {"most", "least"} & {*claim} == ({"most"} if "limit" in said else set())
            weakest = min(self.robot.effort.values()) / self.robot.stiffness
            within = said.get("limit") != "torque" or claim.get("most", 0.0) <= weakest + ROUNDING
            refuse_unless(
                not said or (same and bounded and within),
                f"{claim['name']}: says something else than the claim that ships by this name",
            )
        return sum(name not in ships for name in names)

    def error(self, asked: BoundQuery, where: str, stuck: list[str]) -> Any:
        """Bounds what double precision does to what is asked (rad)."""
        place = asked.state, asked.joint, where, *sorted(stuck)
        if place not in self.rounding:
            box = self.box(where, stuck, asked.state)
            self.rounding[place] = self.targets.rounding(asked.state, asked.joint, box)
        # A slope is one of the exact target, from which no computed one is further than this.
        return self.rounding[place] * {"effect": 2, "slope": 0}.get(asked.of, 1)

    def least(self, asked: BoundQuery, points: list[Point]) -> Any:
        """Returns what is asked, at a point, or as the change from the second to the first."""
        boxes = [{name: (value, value) for name, value in point.items()} for point in points]
        if len(points) == 1 or asked.name is None:
            return -self.targets.bound(asked._replace(sign=-asked.sign), boxes[0])
        rises = asked.of == "effect" or points[0][asked.name] >= points[1][asked.name]
        refuse_unless(rises, "the witnesses of a slope are in the wrong order")
        signs = zip(boxes, (-asked.sign, asked.sign), strict=True)
        target = BoundQuery("target", *asked[1:3], 1)
        return -sum(self.targets.bound(target._replace(sign=sign), box) for box, sign in signs)

    def asked_in(self, own: dict[str, Any]) -> BoundQuery:
        """Returns what a statement bounds, and refuses a statement that is none."""
        refuse_unless({*STATEMENT} <= {*own}, f"a statement lacks one of {STATEMENT}")
        refuse_unless(
            {*own} <= {*STATEMENT, "observation", "stuck", "splits"},
            f"a statement has a key of no use, among {sorted(own)}",
        )
        name, stuck = own.get("observation"), own.get("stuck", [])
        asked = BoundQuery(own["of"], own["state"], own["joint"], own["sign"], name)
        what = f"{asked.of} of {asked.joint} in state {asked.state}"
        refuse_unless(asked.of in ("target", "offset", "slope", "effect"), f"{what}: is not known")
        refuse_unless(type(asked.sign) is int and asked.sign in (1, -1), f"{what}: has no sign")
        refuse_unless(
            type(asked.state) is int and asked.state in range(self.n_states),
            f"{what}: there is no such state",
        )
        refuse_unless(asked.joint in JOINTS, f"{what}: there is no such joint")
        sensed = self.names_sensed()
        moved = asked.of in ("slope", "effect")
        refuse_unless(name in sensed if moved else name is None, f"{what}: of no observation")
        counted = asked.of == "slope" and name in COUNTED
        refuse_unless(not counted, f"{what}: {name} counts steps, and has no slope")
        refuse_unless(own["box"] in BOXES, f"{what}: there is no such box")
        refuse_unless(
            isinstance(stuck, list) and {*stuck} <= {*sensed} and len({*stuck}) == len(stuck),
            f"{what}: what is stuck is no observation",
        )
        refuse_unless(is_number(own["bound"]), f"{what}: NaN")
        return asked

    def check_statement(self, own: dict[str, Any]) -> None:
        asked, stuck = self.asked_in(own), own.get("stuck", [])
        what = f"{asked.of} of {asked.joint} in state {asked.state}"
        box = self.box(own["box"], stuck, asked.state)
        error = self.error(asked, own["box"], stuck)
        bound = self.targets.bound(asked, box, own.get("splits", [])) + error
        refuse_unless(bound <= own["bound"], f"{what}: the bound {own['bound']} is not proved")
        key = *asked, own["box"], *sorted(stuck)
        self.proved[key] = min(own["bound"], self.proved.get(key, math.inf))

    def check_claim(self, claim: dict[str, Any]) -> str:
        """Decides a claim again, from bounds that hold or from its witnesses."""
        check_keys(claim, self.gait.states, self.names_sensed())
        kind, outcome, points = claim["kind"], claim["outcome"], claim["witnesses"]
        states = [self.gait.states.index(one) for one in claim.get("states", [])]
        scope = list(ways(states or range(self.n_states), claim.get("joints") or JOINTS))
        where, stuck = claim.get("box", "operating"), claim.get("stuck", [])
        for point in points:
            refuse_unless(list(point) == self.names, f"{claim['name']}: its witness is none")
            state = next((i for i in range(self.n_states) if point[f"s{i}"] == 1.0), -1)
            inside = state >= 0 and holds(self.box(where, stuck, state), point)
            refuse_unless(
                inside and (not states or state in states),
                f"{claim['name']}: its witness is not where the claim is made",
            )
            scope = [own for own in scope if own[0] == state] if outcome == "refuted" else scope
        counts = {"effect": 2, "independent": 2, "change": 2}
        needed = counts.get(kind, 1) if outcome == "refuted" else 0
        refuse_unless(
            len(points) == needed,
            f"{claim['name']}: has {len(points)} witnesses, where {needed} decide it",
        )
        decide = {
            "kept": self.unlimited,
            "independent": self.depends,
            "mirror": self.lopsided,
            "change": self.abrupt,
        }
        breaks = decide.get(kind, self.exceeds)
        right = outcome == "undecided"
        right |= outcome == "proved" and not points and not breaks(claim, scope, [])
        # Of what limits keep nothing is a witness.
        refuted = outcome == "refuted" and kind != "kept" and bool(points)
        right |= refuted and breaks(claim, scope, points)
        refuse_unless(right, f"{claim['name']}: is not {outcome}")
        return outcome

    def limits(
        self, claim: dict[str, Any], state: int, joint: str
    ) -> list[tuple[BoundQuery, float]]:
        """Lists questions, and the limit that each exceeds nowhere."""
        up, down = (BoundQuery("target", state, joint, sign) for sign in (1, -1))
        match claim["kind"]:
            case "limits":
                low, high = self.robot.limits[joint]
                return [(up, claim.get("most", high)), (down, -claim.get("least", low))]
            case "torque":
                most = claim.get("most", self.robot.effort[joint]) / self.robot.stiffness
                return [(own._replace(of="offset"), most) for own in (up, down)]
        asked = down if claim.get("never") == "falls" else up
        asked = asked._replace(of="slope" if claim["kind"] == "never" else "effect")
        most = claim.get("most", 0.0)
        used = self.targets.used(state, joint)
        names = [name for name in observations(claim, joint) if name in used]
        if claim["kind"] == "never":
            box = self.box(claim.get("box", "operating"), claim.get("stuck", []), state)
            names = [name for name in names if box[name][0] < box[name][1]]
        return [(asked._replace(name=name), most) for name in names]

    def unlimited(self, claim: dict[str, Any], scope: list, points: list[Point]) -> bool:
        """Returns whether limits do not keep to what is claimed; no witness breaks it."""
        own = self.target_limits
        if own is None:
            raise RefusedError(f"{claim['name']}: the policy has no limits")
        return not all(own.keep(claim, self.robot, joint) for _, joint in scope)

    def exceeds(self, claim: dict[str, Any], scope: list, points: list[Point]) -> bool:
        """Returns whether a witness breaks a limit; without one, whether a bound is missing."""
        stuck = claim.get("stuck", [])
        place = claim.get("box", "operating"), *sorted(stuck)
        for state, joint in scope:
            for asked, limit in self.limits(claim, state, joint):
                if not points and not self.proved.get((*asked, *place), math.inf) <= limit:
                    return True
                if points:
                    other = [{asked.name: own[asked.name]} for own in points if asked.name]
                    reached = self.least(asked, [points[0] | own for own in other or [{}]])
                    if reached - ROUNDING > limit:
                        return True
            if not points:
                # Of what no bound was needed, there must be targets all the same.
                self.error(BoundQuery("target", state, joint, 1), place[0], stuck)
        return False

    def apart(self, state: int, joint: str, points: list[Point]) -> Any:
        """Returns how far a target goes, at least, from one point to another."""
        asked = [BoundQuery("effect", state, joint, sign, self.names[0]) for sign in (1, -1)]
        return max(0.0, *(self.least(own, points) - ROUNDING for own in asked))

    def depends(self, claim: dict[str, Any], scope: list, points: list[Point]) -> bool:
        for state, joint in scope:
            named = set(observations(claim, joint))
            self.error(BoundQuery("target", state, joint, 1), claim.get("box", "operating"), [])
            if not points and named & self.targets.used(state, joint):
                return True
            alike = points and all(points[0][k] == points[1][k] for k in {*self.names} - named)
            if alike and self.apart(state, joint, points) > 0.0:
                return True
        return False

    def lopsided(self, claim: dict[str, Any], scope: list, points: list[Point]) -> bool:
        image = self.content["mirror"]
        refuse_unless(image is not None, f"{claim['name']}: the gait has no mirror image")
        for state, joint in scope:
            theirs, turn = image_of(joint, image)
            where = claim.get("box", "operating")
            for own in ((state, joint), (image[state], theirs)):
                self.error(BoundQuery("target", *own, 1), where, [])
            # What is seen in the mirror need not lie in the box.
            seen = self.box(where, [], state)
            there = {}
            for name, (low, high) in seen.items():
                new, sign = image_of(name, image)
                there[new] = (low, high) if sign > 0 else (-high, -low)
            self.targets.rounding(image[state], theirs, there)
            if not points and not self.targets.is_mirrored(state, joint, image):
                return True
            if points:
                turned = {name: image_of(name, image) for name in self.names}
                seen = {new: sign * points[0][name] for name, (new, sign) in turned.items()}
                for sign in (1, -1):
                    own = self.least(BoundQuery("target", state, joint, sign), [points[0]])
                    there = BoundQuery("target", image[state], theirs, -sign * turn)
                    if own + self.least(there, [seen]) - ROUNDING > 0.0:
                        return True
        return False

    def abrupt(self, claim: dict[str, Any], scope: list, points: list[Point]) -> bool:
        changes, where = claim["changes"], claim.get("box", "operating")
        by = {}
        for name in self.names:
            kind = name.partition(".")[0]
            by[name] = changes.get(name, 0.0 if kind == "cmd" else changes.get(kind, 0.0))
        if points:
            pairs = [(Fraction(points[0][k]), Fraction(points[1][k]), Fraction(by[k])) for k in by]
            near = all(abs(one - other) <= most for one, other, most in pairs)
            refuse_unless(near, f"{claim['name']}: its witnesses are further apart than it says")
        squares = dict.fromkeys((state for state, _ in scope), 0.0)
        for state, joint in scope:
            error = 2 * self.error(BoundQuery("target", state, joint, 1), where, [])
            if points:
                moved = self.apart(state, joint, points)
            else:
                box, used = self.box(where, [], state), sorted(self.targets.used(state, joint))
                along = [(name, by[name]) for name in used if by[name]]
                moved = sum((self.targets.moved(state, joint, *own, box) for own in along), error)
            squares[state] += (moved / self.robot.action_scale) ** 2
        limit = claim.get("most", ABRUPT)
        return any(own > limit if points else not own <= limit for own in squares.values())


def holds(box: Box, point: Point) -> bool:
    """Returns whether a box holds a point, whose counts are whole."""
    whole = all(point[name] == int(point[name]) for name in COUNTED)
    return (
        whole
        and {*point} == {*box}
        and all(low <= point[name] <= high for name, (low, high) in box.items())
    )


def check(
    certificate: Path,
    policy: Path | None = None,
    gait: Path | None = None,
    robot: Path | None = None,
) -> str:
    """Checks a certificate, and reports in a line what holds.

    Args:
        certificate: The certificate.
        policy: The policy's file; by default the student that ships under the certificate's name.
        gait: The gait's file; by default the one that ships under the certificate's name.
        robot: The robot's file, in the same way.

    Raises:
        RefusedError: if anything in it does not hold, or it cannot be read.
    """
    try:
        return Check(certificate, policy, gait, robot).run()
    except RefusedError:
        raise
    except (OSError, LookupError, TypeError, ValueError, ArithmeticError, AttributeError) as error:
        raise RefusedError(f"cannot be read ({type(error).__name__}: {error})") from error
    except (SyntaxError, StopIteration, RecursionError, MemoryError) as error:
        raise RefusedError(f"cannot be read ({type(error).__name__}: {error})") from error
    except yaml.YAMLError as error:
        raise RefusedError(f"the file of gait or robot cannot be read ({error})") from error
