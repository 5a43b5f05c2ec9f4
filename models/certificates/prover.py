"""Deciding claims: each is proved, refuted by a witness, or left undecided with its best bounds."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.certificates.changes import (
    asymmetry,
    largest_change,
    mirrored_exactly,
    widest_change,
)
from glassgait.models.certificates.claims import Claim
from glassgait.models.certificates.formula_targets import FormulaTargets
from glassgait.models.certificates.maximum import Box
from glassgait.models.certificates.observation_box import (
    ObservationBox,
    operating_box,
    physical_box,
)
from glassgait.models.certificates.question import (
    BoundQuery,
    Of,
    Place,
    Statement,
    counted_of,
    region_of,
    targets_of,
)
from glassgait.models.errors import InputError
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import entries_of
from glassgait.models.task.symmetry import mirrored_states

GAPS = {"operating": 0.008, "physical": 0.05}
"""Share of a joint's range that a bound over each box may be away from its witness.

Where no robot goes a bound need not be sharp: over the physical box a proof of 0.008 takes up to
forty times the room of all the others."""

FINE = 1e-7
"""The same in a second search, towards what a claim says (rad)."""

REFUTED = 1e-8
"""By how much a witness must break a claim (rad, or rad per unit): more than double precision can.
"""

SLACK = 1e-11
"""Added to bounds: a checker computes them in its own way, and widens bins by a tenth of it."""

UNASKED = "nothing of theirs asks for it"

Outcome = Literal["proved", "refuted", "undecided"]

OUTCOMES: tuple[Outcome, ...] = ("proved", "refuted", "undecided")

Observed = dict[str, float]
"""An observation in the robot's units, by symbol."""


@dataclass(frozen=True)
class Verdict:
    """What became of a claim.

    Attributes:
        claim: The claim.
        outcome: Whether it holds.
        worst: What comes closest to breaking it, or breaks it, in the claim's unit: a value that is
            never exceeded if proved, the witness's if refuted, else the best bound.
        claimed: What the claim allows there.
        where: Joint, state and observation of `worst`, in words.
        witnesses: Observations that refute it; two where a change does.
    """

    claim: Claim
    outcome: Outcome
    worst: float
    claimed: float
    where: str
    witnesses: tuple[Observed, ...] = ()


class Prover:
    """Proves and refutes claims about one policy, and keeps what it has proved.

    Attributes:
        policy: The policy.
        gait: Its gait.
        boxes: The boxes by name.
        statements: All that was proved, in the order in which it was.
    """

    def __init__(self, policy: Policy, gait: Gait, operating: ObservationBox | None = None) -> None:
        """
        Args:
            policy: The policy.
            gait: Its gait.
            operating: The operating box; the gait's shipped one by default.

        Raises:
            InputError: if nothing is proved of such a policy, or there is no operating box.
        """
        self.policy = policy
        self.gait = gait
        operating = operating or operating_box(gait, policy.robot)
        if operating.names != policy.observation_names:
            raise InputError(
                f"the operating box of the {gait.name} is of other observations than those of the "
                "policy; add --measure to 'glassgait verify prove', or give its file by --box"
            )
        self.boxes: Mapping[str, ObservationBox] = {
            "operating": operating,
            "physical": physical_box(gait, operating),
        }
        self.statements: dict[tuple[BoundQuery, Place], Statement] = {}
        self._errors: dict[tuple[int, int, Place], float] = {}
        self.targets = targets_of(policy)
        self.symbols = [entry.symbol for entry in entries_of(policy.observation_names)]

    def range_of(self, state: int, joint: int, box: str) -> tuple[Statement, Statement]:
        """Bounds a target over a box, from above and from below."""
        above, below = (
            self.statement(BoundQuery("target", state, joint, sign), Place(box)) for sign in (1, -1)
        )
        return above, below

    def statement(
        self, question: BoundQuery, place: Place, threshold: float | None = None
    ) -> Statement:
        """Answers a question over a box, once, and again where a threshold is not yet decided."""
        key = question, place
        kept = self.statements.get(key)
        if kept is None:
            robot = self.policy.robot
            width = robot.upper_limits[question.joint] - robot.lower_limits[question.joint]
            kept = self._asked(question, place, GAPS[place.box] * width, threshold)
        elif threshold is not None and kept.found.reached <= threshold < kept.bound:
            kept = self._asked(question, place, FINE, threshold)
        self.statements[key] = kept
        return kept

    def decide(self, claim: Claim) -> Verdict | None:
        """Decides a claim; None where it says nothing of this gait.

        Raises:
            InputError: if the claim names what the gait's robots do not know.
        """
        claim.refuse_unknown(self.gait, imu=self.policy.layout.imu)
        match claim.kind:
            case "independent":
                return self._independent(claim)
            case "mirror":
                return self._mirrored(claim)
            case "change":
                return self._changed(claim)
            case _:
                return self._bounded(claim)

    def region(self, place: Place, state: int) -> Box:
        """Returns the box of a place, with the machine's state held."""
        box, physical = self.boxes[place.box], self.boxes["physical"]
        taken = [box.names[index] for index in place.stuck]
        return region_of(box.taking(taken, physical), state)

    def observed(self, quantities: Array) -> Observed:
        """Names the quantities of an observation (n), counts whole in spite of rounding."""
        counted = sorted(counted_of(self.policy.observation_names))
        quantities = quantities.copy()
        quantities[counted] = np.round(quantities[counted])
        return dict(zip(self.symbols, quantities.tolist(), strict=False))

    def _asked(
        self, question: BoundQuery, place: Place, gap: float, threshold: float | None
    ) -> Statement:
        region = self.region(place, question.state)
        found = self.targets.answer(question, region, gap=gap, threshold=threshold)
        # A slope is one of the exact target, from which a computed one is less than `FINE` away.
        errors = {"slope": 0.0, "effect": 2.0}.get(question.of, 1.0)
        error = self._rounding(question.state, question.joint, place)
        return Statement(question, place, found, errors * error + SLACK)

    def _rounding(self, state: int, joint: int, place: Place) -> float:
        key = state, joint, place
        if key not in self._errors:
            self._errors[key] = self._rounded(state, joint, place)
        return self._errors[key]

    def _rounded(self, state: int, joint: int, place: Place) -> float:
        try:
            return self.targets.rounding(state, joint, self.region(place, state))
        except InputError as error:
            where = f"{quadruped.JOINTS[joint]} in {self.gait.states[state]}"
            raise InputError(f"{where}: {error}") from error

    def _bounded(self, claim: Claim) -> Verdict:
        """Decides a claim that bounds what is asked of every joint and state."""
        place = Place(claim.box, tuple(self.symbols.index(name) for name in claim.stuck))
        found: list[tuple[Statement, float]] = []
        for state in claim.state_indices(self.gait):
            for joint in claim.joint_indices():
                for question, limit in self._questions(claim, state, joint):
                    statement = self.statement(question, place)
                    if statement.found.reached <= limit < statement.bound:
                        statement = self.statement(question, place, limit)
                    found.append((statement, limit))
        if not found:
            return Verdict(claim, "proved", 0.0, claim.most or 0.0, UNASKED)
        unit = self.policy.robot.stiffness if claim.kind == "torque" else 1.0
        reached, allowed = max(found, key=lambda own: own[0].found.reached - own[1])
        if reached.found.reached > allowed + REFUTED:
            witnesses = self._witnesses(reached)
            value = unit * reached.question.sign * reached.found.reached
            return self._verdict(claim, "refuted", value, unit * allowed, reached, witnesses)
        tightest, allowed = max(found, key=lambda own: own[0].bound - own[1])
        outcome: Outcome = "proved" if tightest.bound <= allowed else "undecided"
        value = unit * tightest.question.sign * tightest.bound
        return self._verdict(claim, outcome, value, unit * allowed, tightest, ())

    def _questions(self, claim: Claim, state: int, joint: int) -> list[tuple[BoundQuery, float]]:
        """Lists what must not be greater than what, for a claim to hold."""
        match claim.kind:
            case "limits":
                robot = self.policy.robot
                ends = ((1, claim.greatest(robot, joint)), (-1, -claim.smallest(robot, joint)))
                return [(BoundQuery("target", state, joint, sign), end) for sign, end in ends]
            case "torque":
                robot = self.policy.robot
                most = claim.greatest(robot, joint) / robot.stiffness
                return [(BoundQuery("offset", state, joint, sign), most) for sign in (1, -1)]
        of: Of = "slope" if claim.kind == "never" else "effect"
        sign = -1 if claim.never == "falls" else 1
        # Tables and trees have steps, of which each is steeper than any slope.
        steps = claim.kind == "never" and not isinstance(self.targets, FormulaTargets)
        limit = 0.0 if steps else claim.most or 0.0
        used = self.targets.used(state, joint)
        if claim.kind == "never":
            place = Place(claim.box, tuple(self.symbols.index(name) for name in claim.stuck))
            region = self.region(place, state)
            used &= frozenset(np.flatnonzero(region.lower < region.upper).tolist())
        return [
            (BoundQuery(of, state, joint, sign, index), limit)
            for index in claim.observations_of(joint, self.symbols)
            if index in used
        ]

    def _verdict(
        self,
        claim: Claim,
        outcome: Outcome,
        value: float,
        allowed: float,
        statement: Statement,
        witnesses: tuple[Observed, ...],
    ) -> Verdict:
        question = statement.question
        where = f"{quadruped.JOINTS[question.joint]}, {self.gait.states[question.state]}"
        if question.observation is not None:
            where += f", {self.symbols[question.observation]}"
        claimed = question.sign * allowed + 0.0
        return Verdict(claim, outcome, value, claimed, where, witnesses)

    def _witnesses(self, statement: Statement) -> tuple[Observed, ...]:
        """Returns the observation that reaches it, and of an effect the one that it starts from."""
        witness, index = statement.found.witness, statement.question.observation
        n = len(self.symbols)
        first = self.observed(witness[:n])
        if len(witness) == n or index is None:
            return (first,)
        return first, {**first, self.symbols[index]: float(witness[n])}

    def _independent(self, claim: Claim) -> Verdict:
        place = Place(claim.box)
        for state in claim.state_indices(self.gait):
            for joint in claim.joint_indices():
                used = self.targets.used(state, joint)
                for index in claim.observations_of(joint, self.symbols):
                    if index not in used:
                        continue
                    question = BoundQuery("effect", state, joint, 1, index)
                    found = self.statement(question, place)
                    reached = found.found.reached
                    broken = reached > REFUTED
                    outcome: Outcome = "refuted" if broken else "undecided"
                    witnesses = self._witnesses(found) if broken else ()
                    value = reached if broken else found.bound
                    return self._verdict(claim, outcome, value, 0.0, found, witnesses)
        return Verdict(claim, "proved", 0.0, 0.0, UNASKED)

    def _mirrored(self, claim: Claim) -> Verdict | None:
        images = mirrored_states(self.gait)
        if images is None:
            return None
        if mirrored_exactly(self.targets, images, self.policy.observation_names):
            return Verdict(claim, "proved", 0.0, 0.0, "each formula is its image's image")
        box = self.boxes[claim.box]
        difference, joint, quantities = asymmetry(self.policy, images, box)
        where = f"{quadruped.JOINTS[joint]} and its image"
        if difference > FINE:
            witness = self.observed(quantities)
            return Verdict(claim, "refuted", difference, 0.0, where, (witness,))
        return Verdict(claim, "undecided", difference, 0.0, where)

    def _changed(self, claim: Claim) -> Verdict:
        box, most = self.boxes[claim.box], claim.greatest(self.policy.robot, 0)
        changes = np.array([claim.change_of(symbol) for symbol in self.symbols])
        states = claim.state_indices(self.gait)
        joints = np.array(claim.joint_indices())
        regions = {state: region_of(box, state) for state in states}
        bounds = {
            state: largest_change(self.policy.robot, self.targets, state, joints, changes, region)
            for state, region in regions.items()
        }
        worst = max(bounds, key=lambda state: bounds[state])
        where = f"state {self.gait.states[worst]}"
        if bounds[worst] <= most:
            return Verdict(claim, "proved", bounds[worst], most, where)
        reached = {
            state: widest_change(self.policy, joints, changes, box.in_state(state), region)
            for state, region in regions.items()
        }
        worst = max(reached, key=lambda state: reached[state][0])
        value, *pair = reached[worst]
        where = f"state {self.gait.states[worst]}"
        if value > most:
            witnesses = tuple(self.observed(one) for one in pair)
            return Verdict(claim, "refuted", value, most, where, witnesses)
        return Verdict(claim, "undecided", max(bounds.values()), most, where)
