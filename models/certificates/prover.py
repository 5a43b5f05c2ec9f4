"""Decides claims: each is proved, refuted by a witness, or left undecided with its best bounds."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import product
from typing import Literal, NamedTuple

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.certificates.box import ObservationBox, operating_box, physical_box
from glassgait.models.certificates.claims import Claim
from glassgait.models.certificates.maximum import Maximum, Tree
from glassgait.models.certificates.targets import FormulaTargets, Query
from glassgait.models.errors import InputError
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import REFLECT_JOINTS, reflect_observation, symbols_of
from glassgait.models.task.symmetry import mirrored_states

GAPS = {"operating": 0.008, "physical": 0.05}
"""Greatest difference of a bound and its witness in each box, as a share of a joint's range.

In the physical box, a proof with 0.008 takes up to forty times the space of all the others."""

FINE = 1e-7  # greatest difference in a second search, near the limit of a claim (rad)

REFUTED, SLACK = 1e-8, 1e-11
"""Least excess of a refuting witness, and addition to all bounds (rad, or rad per unit)."""

SAMPLES = 5000  # number of random observations among which witnesses are searched

Outcome = Literal["proved", "refuted", "undecided"]

Observed = dict[str, float]  # an observation in the robot's units, by symbol


@dataclass(frozen=True)
class Verdict:
    """The outcome of a claim: the `worst` bound or value of a witness, and the limit `claimed`.

    A claim is proved by the splits of its box for each bound, and refuted by witnesses: one
    observation, or two for an effect or a change.
    """

    claim: Claim
    outcome: Outcome
    worst: float
    claimed: float
    where: str
    splits: dict[str, list] = field(default_factory=dict)
    witnesses: tuple[Observed, ...] = ()


class Place(NamedTuple):
    """A box by name, and the observations, by index, that vary over the physical box instead."""

    box: str
    stuck: tuple[int, ...] = ()


class Prover:
    """Proves and refutes claims about one policy of formulas."""

    def __init__(self, policy: Policy, gait: Gait, operating: ObservationBox | None = None) -> None:
        # The policy, its machine and the box must belong together.
        if not isinstance(policy, FormulaPolicy):
            raise InputError(
                f"claims of policies of kind {policy.kind!r} are not proved; name formulas"
            )
        policy.refuse_other_machine(gait)
        operating = operating or operating_box(gait, policy.robot)
        if operating.names != policy.observation_names:
            raise InputError(
                f"the operating box of the {gait.name} has other observations than the policy; add "
                "--measure to 'glassgait verify prove', or give its file by --box"
            )

        # Cache bounds and errors, because several claims need the same ones.
        self.policy, self.gait = policy, gait
        self.boxes = {"operating": operating, "physical": physical_box(gait, operating)}
        self.symbols = symbols_of(policy.observation_names)
        self._bounds: dict[tuple[Query, Place], Maximum] = {}
        self._error = cache(self._rounding)
        self._targets = FormulaTargets(policy)
        self._units = RobotUnits.of(policy.robot, policy.observation_names)

    def decide(self, claim: Claim) -> Verdict | None:
        """Decides a claim; returns None for a mirror claim if the gait has no mirror image."""
        claim.refuse_unknown(self.gait, imu=self.policy.layout.imu)
        decide = {"mirror": self._mirrored, "change": self._changed}.get(claim.kind, self._bounded)
        return decide(claim)

    def _box(self, place: Place, state: int) -> ObservationBox:
        physical = self.boxes["physical"]
        return self.boxes[place.box].updated(place.stuck, physical).in_state(state)

    def _bound(self, query: Query, place: Place, limit: float) -> Maximum:
        """Bounds a quantity, tightly enough to decide whether it exceeds a limit if possible."""
        maximum = self._bounds.get((query, place))
        if maximum is None:
            robot = self.policy.robot
            width = robot.upper_limits[query.joint] - robot.lower_limits[query.joint]
            maximum = self._search(query, place, GAPS[place.box] * width)
        if maximum.reached <= limit < maximum.bound:
            maximum = self._search(query, place, FINE, limit)
        self._bounds[query, place] = maximum
        return maximum

    def _search(
        self, query: Query, place: Place, gap: float, threshold: float | None = None
    ) -> Maximum:
        # A slope is that of the exact target; a computed target differs from it by less than FINE.
        errors = {"target": 1.0, "slope": 0.0, "effect": 2.0}[query.of]
        error = errors * self._error(query.state, query.joint, place)
        box = self._box(place, query.state)
        maximum = self._targets.bound(query, box, gap=gap, threshold=threshold)
        return replace(maximum, bound=maximum.bound + error + SLACK)

    def _rounding(self, state: int, joint: int, place: Place) -> float:
        try:
            return self._targets.rounding(state, joint, self._box(place, state))
        except InputError as error:
            where = f"{quadruped.JOINTS[joint]} in {self.gait.states[state]}"
            raise InputError(f"{where}: {error}") from error

    def _bounded(self, claim: Claim) -> Verdict:
        """Decides a claim that bounds a quantity of every joint and state."""
        place = Place(claim.box, tuple(self.symbols.index(name) for name in claim.stuck))
        results = [
            (query, self._bound(query, place, limit), limit)
            for state, joint in product(claim.state_indices(self.gait), claim.joint_indices())
            for query, limit in self._queries(claim, place, state, joint)
        ]
        if not results:
            return Verdict(claim, "proved", 0.0, self._most(claim), "no target depends on it")

        # A witness refutes it; otherwise the bound closest to its limit decides.
        query, maximum, limit = max(results, key=lambda result: result[1].reached - result[2])
        if maximum.reached > limit + REFUTED:
            return self._verdict(claim, "refuted", maximum.reached, limit, query, maximum.witness)
        query, maximum, limit = max(results, key=lambda result: result[1].bound - result[2])
        if maximum.bound > limit:
            return self._verdict(claim, "undecided", maximum.bound, limit, query)
        splits = {self._key(query): self._named(maximum.splits) for query, maximum, _ in results}
        verdict = self._verdict(claim, "proved", maximum.bound, limit, query)
        return replace(verdict, splits={key: tree for key, tree in splits.items() if tree})

    def _queries(
        self, claim: Claim, place: Place, state: int, joint: int
    ) -> list[tuple[Query, float]]:
        """Lists the quantities that a claim bounds, each with its limit."""
        if claim.kind == "limits":
            ends = ((1, self._most(claim)), (-1, -(claim.least or 0.0)))
            return [(Query("target", state, joint, sign), end) for sign, end in ends]
        of = "slope" if claim.kind == "never" else "effect"
        sign = -1 if claim.never == "falls" else 1
        used = self._targets.used(state, joint)
        if claim.kind == "never":
            box = self._box(place, state)
            used &= frozenset(np.flatnonzero(box.lower < box.upper).tolist())
        return [
            (Query(of, state, joint, sign, index), self._most(claim))
            for index in claim.observations_of(joint, self.symbols)
            if index in used
        ]

    def _most(self, claim: Claim) -> float:
        return claim.number(self.policy.robot, self.policy.joint_law)

    def _key(self, query: Query) -> str:
        """Names a bound as certificates do."""
        name = self.symbols[query.observation] if query.observation >= 0 else None
        name = name or ("most" if query.sign > 0 else "least")
        return f"{quadruped.JOINTS[query.joint]} {query.state} {name}"

    def _named(self, tree: Tree) -> list:
        """Names the quantities of a tree of splits."""
        if not tree:
            return []
        index, cut, below, above = tree
        return [[*self.symbols, "other"][index], cut, self._named(below), self._named(above)]

    def _verdict(
        self,
        claim: Claim,
        outcome: Outcome,
        value: float,
        limit: float,
        query: Query,
        witness: Array | None = None,
    ) -> Verdict:
        where, n = [quadruped.JOINTS[query.joint], self.gait.states[query.state]], len(self.symbols)
        where += [self.symbols[query.observation]] if query.observation >= 0 else []
        witnesses = [] if witness is None else [self._observed(witness[:n])]
        if witness is not None and len(witness) > n:
            # The witness of an effect ends with the other value of the observation.
            witnesses.append({**witnesses[0], where[-1]: float(witness[n])})
        value, limit = query.sign * value, query.sign * limit + 0.0
        return Verdict(claim, outcome, value, limit, ", ".join(where), {}, tuple(witnesses))

    def _observed(self, quantities: Array) -> Observed:
        """Names the quantities of an observation (n), and rounds counts to whole numbers."""
        counted = list(self.boxes["operating"].counted)
        quantities = quantities.copy()
        quantities[counted] = np.round(quantities[counted])
        return dict(zip(self.symbols, quantities.tolist(), strict=True))

    def _mirrored(self, claim: Claim) -> Verdict | None:
        images = mirrored_states(self.gait)
        if images is None:
            return None
        if self._targets.are_mirrored(images):
            return Verdict(claim, "proved", 0.0, 0.0, "each formula is its image's image")
        # Compare the policy with its mirror image at random observations.
        quantities = self.boxes[claim.box].random(SAMPLES, np.random.default_rng(0))
        observations = self._units.observed(quantities)
        reflection = reflect_observation(self.policy.observation_names, images)
        image = REFLECT_JOINTS(self.policy(reflection(observations)))
        difference = self.policy.robot.action_scale * np.abs(self.policy(observations) - image)
        row, joint = np.unravel_index(int(np.argmax(difference)), difference.shape)
        worst, where = float(difference[row, joint]), f"{quadruped.JOINTS[joint]} and its image"
        if worst > FINE:
            witness = self._observed(quantities[row])
            return Verdict(claim, "refuted", worst, 0.0, where, witnesses=(witness,))
        return Verdict(claim, "undecided", worst, 0.0, where)

    def _changed(self, claim: Claim) -> Verdict:
        """Decides a claim about the squared change of the action."""
        # Bound the change in each state, then look for one that is too great.
        most, joints = self._most(claim), claim.joint_indices()
        changes = np.array([claim.change_of(symbol) for symbol in self.symbols])
        place, bounds, reached = Place(claim.box), {}, {}
        for state in claim.state_indices(self.gait):
            squares = (self._squared_change(state, joint, changes, place) for joint in joints)
            bounds[sum(squares)] = f"state {self.gait.states[state]}"
        if (bound := max(bounds)) <= most:
            return Verdict(claim, "proved", bound, most, bounds[bound])
        for state in claim.state_indices(self.gait):
            value, *pair = self._widest_change(joints, changes, self._box(place, state))
            reached[value] = f"state {self.gait.states[state]}", map(self._observed, pair)
        if (value := max(reached)) > most:
            where, witnesses = reached[value]
            return Verdict(claim, "refuted", value, most, where, witnesses=tuple(witnesses))
        return Verdict(claim, "undecided", bound, most, bounds[bound])

    def _squared_change(self, state: int, joint: int, changes: Array, place: Place) -> float:
        """Bounds the squared change of an action if quantities change by `changes` (n)."""
        targets, box = self._targets, self._box(place, state)
        used = sorted(targets.used(state, joint) & {*np.flatnonzero(changes).tolist()})
        most = sum(targets.change(state, joint, i, float(changes[i]), box) for i in used)
        most += 2.0 * self._error(state, joint, place)
        return (most / self.policy.robot.action_scale) ** 2

    def _widest_change(
        self, joints: Sequence[int], changes: Array, box: ObservationBox
    ) -> tuple[float, Array, Array]:
        """Samples a box; returns the widest squared change of the action, and where (n, n)."""
        generator = np.random.default_rng(0)
        counted = np.isin(np.arange(len(changes)), list(box.counted))
        # Slightly less, so that rounding moves no two witnesses further apart than `changes`.
        changes = np.where(counted, np.floor(changes), (1.0 - 1e-12) * changes)
        first = box.random(SAMPLES, generator)
        second = first + generator.choice([-1.0, 1.0], first.shape) * changes
        second = np.clip(second, box.lower, box.upper)
        before, after = (self.policy(self._units.observed(x))[..., joints] for x in (first, second))
        squared = np.sum(np.square(after - before), axis=-1)
        widest = int(np.argmax(squared))
        return float(squared[widest]), first[widest], second[widest]
