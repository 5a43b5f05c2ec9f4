"""Deciding claims: each is proved, refuted by a witness, or left undecided with its best bounds."""

from collections.abc import Mapping, Sequence
from functools import cache
from itertools import product
from typing import ClassVar, Literal

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.certificates.claims import Claim
from glassgait.models.certificates.formula_targets import FormulaTargets
from glassgait.models.certificates.observation_box import (
    ObservationBox,
    operating_box,
    physical_box,
)
from glassgait.models.certificates.question import (
    BoundQuery,
    Box,
    Of,
    Place,
    Statement,
    counted_of,
    region_of,
)
from glassgait.models.errors import InputError
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.target_limits import TargetLimits
from glassgait.models.settings import Settings, checked
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import symbols_of
from glassgait.models.task.symmetry import REFLECT_JOINTS, mirrored_states, reflect_observation
from glassgait.models.task.termination import PHYSICAL_FALL

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

KEPT = 1e-9
"""By how much what limits guarantee may be exceeded because of rounding (rad, N·m)."""

SAMPLES = 1000
"""Observations among which a policy is compared with its mirror image."""

PAIRS = 512
SWEEPS = 3
"""A wide change is sought among random pairs at the ends, then quantity by quantity."""

UNASKED = "nothing of theirs asks for it"

Outcome = Literal["proved", "refuted", "undecided"]

OUTCOMES: tuple[Outcome, ...] = ("proved", "refuted", "undecided")

Observed = dict[str, float]
"""An observation in the robot's units, by symbol."""


@checked
class Verdict(Settings):
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

    title: ClassVar[str] = "verdict"

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
        statements: All that was bounded.
        proofs: The bounds of which proofs of claims consist; a refutation is its witness.
        targets: What bounds are proved of.
    """

    def __init__(self, policy: Policy, gait: Gait, operating: ObservationBox | None = None) -> None:
        """
        Args:
            policy: The policy.
            gait: Its gait.
            operating: The operating box; the gait's shipped one by default.

        Raises:
            InputError: if there is no operating box, the policy holds another machine, or it is
                not made of formulas.
        """
        if not isinstance(policy, FormulaPolicy):
            raise InputError(
                f"claims of policies of kind {policy.kind!r} are not proved; name a policy of "
                "formulas"
            )
        policy.refuse_other_machine(gait)
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
        self.proofs: dict[tuple[BoundQuery, Place], Statement] = {}
        self._rounding = cache(self._rounded)
        self.targets = FormulaTargets(policy)
        self.stiffness, _ = policy.joint_law.gains_of(policy.robot)
        self.symbols = symbols_of(policy.observation_names)

    def statement(
        self, question: BoundQuery, place: Place, threshold: float | None = None
    ) -> Statement:
        """Answers a question over a box, once, and again where a threshold is not yet decided."""
        kept = self.statements.get((question, place))
        if kept is None:
            robot = self.policy.robot
            width = robot.upper_limits[question.joint] - robot.lower_limits[question.joint]
            kept = self._asked(question, place, GAPS[place.box] * width, threshold)
        elif threshold is not None and kept.found.reached <= threshold < kept.bound:
            kept = self._asked(question, place, FINE, threshold)
        self.statements[question, place] = kept
        return kept

    def decide(self, claim: Claim) -> Verdict | None:
        """Decides a claim; None where it says nothing of this gait or of such a policy.

        Raises:
            InputError: if the claim names what the gait's robots do not know.
        """
        claim.refuse_unknown(self.gait, imu=self.policy.layout.imu)
        match claim.kind:
            case "kept":
                return self._kept(claim)
            case "mirror":
                return self._mirrored(claim)
            case "independent":
                return self._independent(claim)
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

    def _rounded(self, state: int, joint: int, place: Place) -> float:
        try:
            return self.targets.rounding(state, joint, self.region(place, state))
        except InputError as error:
            where = f"{quadruped.JOINTS[joint]} in {self.gait.states[state]}"
            raise InputError(f"{where}: {error}") from error

    def _kept(self, claim: Claim) -> Verdict | None:
        """Decides a claim about the targets that limits leave, by what limits guarantee."""
        limits = self.policy.joint_law.limits
        if limits is None:
            return None
        bounds = [
            (value - claimed, joint, value, claimed)
            for joint in claim.joint_indices()
            for value, claimed in self._guaranteed(claim, limits, joint)
        ]
        exceeds, joint, value, claimed = max(bounds, key=lambda own: own[0])
        outcome: Outcome = "proved" if exceeds <= KEPT else "undecided"
        return Verdict(claim, outcome, value, claimed, quadruped.JOINTS[joint])

    def _guaranteed(
        self, claim: Claim, limits: TargetLimits, joint: int
    ) -> list[tuple[float, float]]:
        """Lists what limits guarantee not to be exceeded, and what is claimed not to be.

        The reasons stand in `glassgait.models.robots.target_limits`.
        """
        robot = self.policy.robot
        effort = float(robot.effort[joint])
        reach = effort / limits.stiffness
        match claim.keeps:
            case "range":
                low, high = float(robot.lower_limits[joint]), float(robot.upper_limits[joint])
                return [(high - limits.margin, high), (-low - limits.margin, -low)]
            case "rate":
                return [(reach, effort / self.stiffness if claim.most is None else claim.most)]
            case "torque":
                return [(self.stiffness * reach, effort if claim.most is None else claim.most)]
            case "lean":
                return [(limits.lean, PHYSICAL_FALL.lean if claim.most is None else claim.most)]
            case _:
                return [(0.0, 0.0)]

    def _bounded(self, claim: Claim) -> Verdict:
        """Decides a claim that bounds what is asked of every joint and state."""
        place = self._place(claim)
        found: list[tuple[Statement, float]] = []
        for state, joint in product(claim.state_indices(self.gait), claim.joint_indices()):
            for question, limit in self._questions(claim, place, state, joint):
                statement = self.statement(question, place)
                if statement.found.reached <= limit < statement.bound:
                    statement = self.statement(question, place, limit)
                found.append((statement, limit))
        if not found:
            return Verdict(claim, "proved", 0.0, claim.most or 0.0, UNASKED)
        unit = self.stiffness if claim.kind == "torque" else 1.0
        reached, allowed = max(found, key=lambda own: own[0].found.reached - own[1])
        if reached.found.reached > allowed + REFUTED:
            value = unit * reached.question.sign * reached.found.reached
            return self._verdict(claim, "refuted", value, unit * allowed, reached)
        tightest, allowed = max(found, key=lambda own: own[0].bound - own[1])
        outcome: Outcome = "proved" if tightest.bound <= allowed else "undecided"
        if outcome == "proved":
            self.proofs |= {(own.question, own.place): own for own, _ in found}
        value = unit * tightest.question.sign * tightest.bound
        return self._verdict(claim, outcome, value, unit * allowed, tightest)

    def _place(self, claim: Claim) -> Place:
        return Place(claim.box, tuple(self.symbols.index(name) for name in claim.stuck))

    def _questions(
        self, claim: Claim, place: Place, state: int, joint: int
    ) -> list[tuple[BoundQuery, float]]:
        """Lists what must not be greater than what, for a claim to hold."""
        match claim.kind:
            case "limits":
                robot = self.policy.robot
                ends = ((1, claim.greatest(robot, joint)), (-1, -claim.smallest(robot, joint)))
                return [(BoundQuery("target", state, joint, sign), end) for sign, end in ends]
            case "torque":
                robot = self.policy.robot
                most = claim.greatest(robot, joint) / self.stiffness
                return [(BoundQuery("offset", state, joint, sign), most) for sign in (1, -1)]
        of: Of = "slope" if claim.kind == "never" else "effect"
        sign = -1 if claim.never == "falls" else 1
        limit = claim.most or 0.0
        used = self.targets.used(state, joint)
        if claim.kind == "never":
            region = self.region(place, state)
            used &= frozenset(np.flatnonzero(region.lower < region.upper).tolist())
        return [
            (BoundQuery(of, state, joint, sign, index), limit)
            for index in claim.observations_of(joint, self.symbols)
            if index in used
        ]

    def _verdict(
        self, claim: Claim, outcome: Outcome, value: float, allowed: float, statement: Statement
    ) -> Verdict:
        question = statement.question
        witnesses = self._witnesses(statement) if outcome == "refuted" else ()
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
        depends = (
            BoundQuery("effect", state, joint, 1, index)
            for state, joint in product(claim.state_indices(self.gait), claim.joint_indices())
            for index in claim.observations_of(joint, self.symbols)
            if index in self.targets.used(state, joint)
        )
        question = next(depends, None)
        if question is None:
            return Verdict(claim, "proved", 0.0, 0.0, UNASKED)
        found = self.statement(question, Place(claim.box))
        reached = found.found.reached
        if reached > REFUTED:
            return self._verdict(claim, "refuted", reached, 0.0, found)
        return self._verdict(claim, "undecided", found.bound, 0.0, found)

    def _mirrored(self, claim: Claim) -> Verdict | None:
        images = mirrored_states(self.gait)
        if images is None:
            return None
        if self.targets.are_mirrored(images):
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
        joints = claim.joint_indices()
        regions = {state: region_of(box, state) for state in states}
        bounds = {
            state: sum(self._squared_change(state, joint, changes, region) for joint in joints)
            for state, region in regions.items()
        }
        worst = max(bounds, key=lambda state: bounds[state])
        if bounds[worst] <= most:
            return Verdict(claim, "proved", bounds[worst], most, self._in_words(worst))
        reached = {
            state: widest_change(self.policy, joints, changes, box.in_state(state), region)
            for state, region in regions.items()
        }
        worst = max(reached, key=lambda state: reached[state][0])
        value, *pair = reached[worst]
        if value > most:
            witnesses = tuple(self.observed(one) for one in pair)
            return Verdict(claim, "refuted", value, most, self._in_words(worst), witnesses)
        return Verdict(claim, "undecided", max(bounds.values()), most, self._in_words(worst))

    def _squared_change(self, state: int, joint: int, changes: Array, region: Box) -> float:
        """Bounds the squared change of an action, as the sum of what each observation can do.

        Both observations are in the box, and quantities change by `changes` (n) at most.
        """
        targets = self.targets
        used = sorted(targets.used(state, joint) & {*np.flatnonzero(changes).tolist()})
        most = sum(targets.change(state, joint, i, float(changes[i]), region) for i in used)
        most += 2.0 * targets.rounding(state, joint, region)
        return (most / self.policy.robot.action_scale) ** 2

    def _in_words(self, state: int) -> str:
        return f"state {self.gait.states[state]}"


def widest_change(
    policy: Policy,
    joints: Sequence[int],
    changes: Array,
    box: ObservationBox,
    region: Box,
) -> tuple[float, Array, Array]:
    """Seeks two observations of a box between which the action changes most.

    Returns:
        The squared change of the action, and both observations in the robot's units (n, n).
    """
    generator, units = np.random.default_rng(0), RobotUnits.of(box.robot, box.names)
    counted = np.isin(np.arange(len(changes)), list(region.counted))
    # A hair less, so that two witnesses are not a rounding further apart than is claimed.
    changes = np.where(counted, np.floor(changes), (1.0 - 1e-12) * changes)
    first = units.quantities(box.random(PAIRS, generator))
    first = np.clip(first, region.lower, region.upper)
    signs = generator.choice([-1.0, 1.0], first.shape)
    second = np.clip(first + signs * changes, region.lower, region.upper)

    def squared(one: Array, other: Array) -> Array:
        moved = [policy(units.observed(own))[..., list(joints)] for own in (one, other)]
        return np.sum(np.square(moved[1] - moved[0]), axis=-1)

    values = squared(first, second)
    best = int(np.argmax(values))
    one, other, value = first[best], second[best], float(values[best])
    for _ in range(SWEEPS):
        for index in range(len(changes)):
            pairs = _pairs(one, other, index, changes[index], region)
            values = squared(*pairs)
            if values.max() > value:
                best = int(np.argmax(values))
                one, other, value = pairs[0][best], pairs[1][best], float(values[best])
    return value, one, other


def _pairs(one: Array, other: Array, index: int, change: float, region: Box) -> tuple[Array, Array]:
    """Returns pairs that differ from one in one quantity."""
    low, high = region.lower[index], region.upper[index]
    values = np.array([low, high, 0.5 * (low + high), one[index]])
    if index in region.counted:
        values = np.floor(values)
    ends = [np.clip(values + shift, low, high) for shift in (-change, 0.0, change)]
    starts = np.tile(one, (3 * len(values), 1))
    starts[:, index] = np.tile(values, 3)
    goals = np.tile(other, (3 * len(values), 1))
    goals[:, index] = np.concatenate(ends)
    return starts, goals


def asymmetry(
    policy: Policy, images: Sequence[int], box: ObservationBox
) -> tuple[float, int, Array]:
    """Finds where a policy differs most from its mirror image, among random observations.

    Returns:
        The difference of the target (rad), the joint, and the observation in the robot's units (n).
    """
    observations = box.random(SAMPLES, np.random.default_rng(0))
    reflection = reflect_observation(policy.observation_names, images)
    image = REFLECT_JOINTS(policy(reflection(observations)))
    difference = policy.robot.action_scale * np.abs(policy(observations) - image)
    row, joint = np.unravel_index(int(np.argmax(difference)), difference.shape)
    quantities = RobotUnits.of(box.robot, box.names).quantities(observations[row])
    return float(difference[row, joint]), int(joint), quantities
