"""A certificate: every bound checked anew, and every claim decided from what holds."""

import hashlib
import json
import math
import re
import struct
from itertools import product as ways
from pathlib import Path
from typing import Any

from flint import arb

from .bounds import cell_bound, greatest, hull, value_at
from .policies import ACTION_SCALE, JOINTS, MIRRORED, mirrored, read_policy, symbols
from .polynomials import RefusedError, names_in, plus, quantity, refuse_unless, slope, substituted

LIMITS = {"hip": (-0.8029, 0.8029), "thigh": (-1.0472, 4.1888), "calf": (-2.6965, -0.9163)}
STIFFNESS, EFFORT, ABRUPT = 20.0, 33.5, 60.0
COUNTED = ("t", "cmd.t")
SLACK = 1e-9


class Check:
    """A certificate and the policy that it is of.

    Attributes:
        told: What the certificate says.
        targets: Polynomials of each state and joint, as the policy's file has them.
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
            sound = list(box) == self.names and all(low <= high for low, high in box.values())
            refuse_unless(sound, f"the {name} box is no box of this gait's observations")
        self.proved: dict[tuple, float] = {}

    def run(self) -> str:
        """Checks statements, then claims, and tells how many hold."""
        for statement in self.told["statements"]:
            self.check_statement(statement)
        outcomes = [self.check_claim(claim) for claim in self.told["claims"]]
        count = {own: outcomes.count(own) for own in ("proved", "refuted", "undecided")}
        told = ", ".join(f"{number} {own}" for own, number in count.items())
        return f"{len(self.told['statements'])} bounds hold; claims: {told}"

    def asked(self, of: str, state: int, joint: str, name: str | None) -> dict:
        """Returns the polynomial that is bounded."""
        target = self.targets[state][JOINTS.index(joint)]
        if of == "offset":
            return plus(target, quantity(f"q.{joint}"), -1)
        if of == "slope":
            return slope(target, str(name))
        if of == "effect":
            return plus(target, substituted(target, {str(name): quantity("other")}), -1)
        refuse_unless(of == "target", f"a statement of {of!r} is not known")
        return target

    def box(self, where: str, stuck: list[str], state: int) -> dict[str, tuple]:
        """Returns a box with the machine's state held."""
        box = {name: tuple(ends) for name, ends in self.told["boxes"][where].items()}
        box |= {name: tuple(self.told["boxes"]["physical"][name]) for name in stuck}
        return box | {f"s{i}": (float(i == state),) * 2 for i in range(self.n_states)}

    def check_statement(self, own: dict[str, Any]) -> None:
        state, joint, name, stuck = (
            own["state"],
            own["joint"],
            own.get("observation"),
            own.get("stuck", []),
        )
        told = f"{own['of']} of {joint} in state {state}"
        polynomial = plus({}, self.asked(own["of"], state, joint, name), own["sign"])
        refuse_unless(own["sign"] in (1, -1), f"{told}: its sign is {own['sign']}")
        refuse_unless(state in range(self.n_states), f"{told}: there is no such state")
        box, counted = self.box(own["box"], stuck, state), set[str](COUNTED)
        if name is not None:
            box["other"] = box[name]
            if name in COUNTED:
                counted.add("other")
        bound = greatest(polynomial, box, own.get("splits", []), counted)
        refuse_unless(bound <= own["bound"], f"{told}: the bound {own['bound']} is not proved")
        point = {name: low for name, (low, high) in box.items() if low == high} | own["witness"]
        point |= {"other": own["other"]} if "other" in own else {}
        inside = all(low <= point.get(key, low) <= high for key, (low, high) in box.items())
        refuse_unless(inside, f"{told}: the witness is not in the box")
        value = value_at(polynomial, point)
        refuse_unless(value >= own["reached"] - SLACK, f"{told}: the witness is too low")
        key = own["of"], state, joint, own["sign"], name, own["box"], *stuck
        self.proved[key] = min(own["bound"], self.proved.get(key, math.inf))

    def check_claim(self, claim: dict[str, Any]) -> str:
        """Decides a claim again, from bounds that hold or from its witnesses."""
        kind, outcome, points = claim["kind"], claim["outcome"], claim.get("witnesses", [])
        states = [self.told["states"].index(one) for one in claim.get("states", [])]
        scope = list(ways(states or range(self.n_states), claim.get("joints", JOINTS)))
        where, stuck = claim.get("box", "operating"), claim.get("stuck", [])
        for point in points:
            state = next(i for i in range(self.n_states) if point[f"s{i}"] == 1.0)
            inside = all(
                low <= point[key] <= high
                for key, (low, high) in self.box(where, stuck, state).items()
            )
            refuse_unless(
                inside and (states or [state]).count(state),
                f"{claim['name']}: its witness is not where the claim is made",
            )
            scope = [own for own in scope if own[0] == state] if outcome == "refuted" else scope
        decide = {"independent": self.depends, "mirror": self.lopsided, "change": self.abrupt}
        breaks = decide.get(kind, self.exceeds)
        holds = {
            "proved": lambda: not breaks(claim, scope, []),
            "undecided": lambda: True,
            "refuted": lambda: points and breaks(claim, scope, points),
        }
        refuse_unless(outcome in holds and holds[outcome](), f"{claim['name']}: is not {outcome}")
        return outcome

    def observations(self, claim: dict[str, Any], joint: str) -> list[str]:
        return [re.sub(r"\.own$", f".{joint}", name) for name in claim["observations"]]

    def limits(self, claim: dict[str, Any], joint: str) -> list[tuple]:
        """Lists (question, sign, observation, limit), each to be exceeded nowhere."""
        if claim["kind"] == "limits":
            low, high = LIMITS[joint[3:]]
            return [
                ("target", 1, None, claim.get("most", high)),
                ("target", -1, None, -claim.get("least", low)),
            ]
        if claim["kind"] == "torque":
            limit = claim.get("most", EFFORT) / STIFFNESS
            return [("offset", sign, None, limit) for sign in (1, -1)]
        of, most = ("slope", 0.0) if claim["kind"] == "never" else ("effect", claim["most"])
        sign = -1 if claim.get("never") == "falls" else 1
        return [(of, sign, name, most) for name in self.observations(claim, joint)]

    def exceeds(self, claim: dict[str, Any], scope: list, points: list) -> bool:
        """Tells whether a witness breaks a limit; without one, whether a bound is missing."""
        place = claim.get("box", "operating"), *claim.get("stuck", [])
        for state, joint in scope:
            for of, sign, name, limit in self.limits(claim, joint):
                polynomial = self.asked(of, state, joint, name)
                if not points and polynomial:
                    key = of, state, joint, sign, name, *place
                    if not self.proved.get(key, math.inf) <= limit:
                        return True
                elif points and polynomial:
                    other = {"other": points[-1][name]} if of == "effect" else {}
                    if sign * value_at(polynomial, points[0] | other) > limit:
                        return True
        return False

    def depends(self, claim: dict[str, Any], scope: list, points: list) -> bool:
        for state, joint in scope:
            target = self.targets[state][JOINTS.index(joint)]
            named = set(self.observations(claim, joint))
            if not points and named & names_in(target):
                return True
            if points and all(points[0][k] == points[1][k] for k in set(self.names) - named):
                values = [value_at(target, point) for point in points]
                if values[0] > values[1] or values[0] < values[1]:
                    return True
        return False

    def lopsided(self, claim: dict[str, Any], scope: list, points: list) -> bool:
        image = self.told["mirror"]
        for state, joint in scope:
            theirs = self.targets[image[state]][JOINTS.index(MIRRORED[joint[:2]] + joint[2:])]
            rest = plus(
                self.targets[state][JOINTS.index(joint)], mirrored(theirs, joint, image), -1
            )
            if rest and (not points or not value_at(rest, points[0]).contains(0)):
                return True
        return False

    def abrupt(self, claim: dict[str, Any], scope: list, points: list) -> bool:
        changes, where = claim["changes"], claim.get("box", "operating")
        by = {}
        for name in self.names:
            kind = name.partition(".")[0]
            by[name] = changes.get(name, 0.0 if kind == "cmd" else changes.get(kind, 0.0))
        if points:
            refuse_unless(
                all(abs(points[0][k] - points[1][k]) <= by[k] + SLACK for k in by),
                f"{claim['name']}: its witnesses are further apart than it says",
            )
        squares = {state: arb(0) for state, _ in scope}
        for state, joint in scope:
            target = self.targets[state][JOINTS.index(joint)]
            if points:
                moved = value_at(target, points[0]) - value_at(target, points[1])
            else:
                box = self.box(where, [], state)
                along = [(by[name], slope(target, name)) for name in names_in(target)]
                moved = sum(
                    (
                        arb(most)
                        * hull([cell_bound(own, box), cell_bound(plus({}, own, -1), box)])[1]
                        for most, own in along
                        if most
                    ),
                    arb(0),
                )
            squares[state] += (moved / ACTION_SCALE) ** 2
        limit = claim.get("most", ABRUPT)
        return any(own > limit if points else not own <= limit for own in squares.values())


def check(certificate: Path, policy: Path | None = None) -> str:
    """Checks a certificate, and tells in a line what holds.

    Raises:
        RefusedError: if anything in it does not hold, or it cannot be read.
    """
    try:
        return Check(certificate, policy).run()
    except RefusedError:
        raise
    except (
        OSError,
        ValueError,
        KeyError,
        TypeError,
        IndexError,
        AttributeError,
        SyntaxError,
        StopIteration,
        RecursionError,
        struct.error,
    ) as error:
        raise RefusedError(f"cannot be read ({type(error).__name__}: {error})") from error
