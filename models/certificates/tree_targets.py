"""Sound bounds of targets that are sums of trees: what every tree by itself can add.

The bound is no maximum: trees are bounded each by itself, though they ask for the same
observations.
"""

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.certificates.maximum import Box, Maximum
from glassgait.models.certificates.question import BoundQuery
from glassgait.models.certificates.rounding import sum_error
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.task.observation import indices_of

SLACK = 1e-12
"""Boxes are wider by it, in the observation's units."""

SAMPLES = 256
SWEEPS = 2
VALUES = 7
"""A witness is sought among random corners, from the best of them quantity by quantity."""


class TreeTargets:
    """Targets of a policy of boosted trees."""

    def __init__(self, policy: BoostedTreesPolicy) -> None:
        self._policy = policy
        self._units = RobotUnits.of(policy.robot, policy.observation_names)
        self._positions = indices_of("joint position", policy.observation_names)

    def used(self, state: int, joint: int) -> frozenset[int]:
        policy = self._policy
        asked = np.isfinite(policy.thresholds[joint])
        return frozenset(policy.features[joint][asked].tolist())

    def rounding(self, state: int, joint: int, region: Box) -> float:
        leaves = np.abs(self._policy.leaves[joint]).max(axis=-1).tolist()
        # As much again, twice, for the sums of bounds: here, and in a checker.
        return 3.0 * sum_error(
            self._policy.robot, [float(self._policy.intercepts[joint]), *leaves], joint
        )

    def answer(
        self, question: BoundQuery, region: Box, *, gap: float, threshold: float | None = None
    ) -> Maximum:
        joint, sign = question.joint, float(question.sign)
        least, most = self._ends_of_trees(joint, region)
        if question.of in ("slope", "effect"):
            return self._change(question, region, most - least)
        ends = most if sign > 0 else -least
        constant = self._policy.robot.default_stance[joint]
        constant += self._policy.robot.action_scale * self._policy.intercepts[joint]
        bound = sign * constant + self._policy.robot.action_scale * ends.sum()
        if question.of == "offset":
            angle = region.lower if sign > 0 else -region.upper
            bound -= angle[self._positions[joint]]
        witness, reached = self._witness(question, region)
        return Maximum(float(max(bound, reached)), reached, witness)

    def change(self, state: int, joint: int, index: int, most: float, region: Box) -> float:
        question = BoundQuery("effect", state, joint, 1, index)
        return self.answer(question, region, gap=0.0).bound

    def _change(self, question: BoundQuery, region: Box, spans: Array) -> Maximum:
        """Bounds an effect by the trees that ask for the observation; it bounds steps too."""
        policy, joint = self._policy, question.joint
        asks = (policy.features[joint] == question.observation) & np.isfinite(
            policy.thresholds[joint]
        )
        bound = self._policy.robot.action_scale * float(spans[asks.any(axis=-1)].sum())
        return Maximum(bound, 0.0, np.append(region.lower, region.lower[question.observation]))

    def _ends_of_trees(self, joint: int, region: Box) -> tuple[Array, Array]:
        """Returns the least and the greatest leaf that each tree can reach (n_trees, n_trees)."""
        policy = self._policy
        lower, upper = self._observed(region.lower) - SLACK, self._observed(region.upper) + SLACK
        features, thresholds = policy.features[joint], policy.thresholds[joint]
        reached = np.ones((len(features), 1), dtype=bool)
        # A box is one of nodes, so that a leaf below two questions of one observation may be
        # counted in though no observation of the box falls into it.
        for level in range(policy.depth):
            nodes = slice(2**level - 1, 2 ** (level + 1) - 1)
            left = reached & (lower[features[:, nodes]] <= thresholds[:, nodes])
            right = reached & (upper[features[:, nodes]] > thresholds[:, nodes])
            reached = np.stack([left, right], axis=-1).reshape(len(features), -1)
        leaves = policy.leaves[joint]
        least = np.where(reached, leaves, np.inf).min(axis=-1)
        return least, np.where(reached, leaves, -np.inf).max(axis=-1)

    def _witness(self, question: BoundQuery, region: Box) -> tuple[Array, float]:
        generator = np.random.default_rng(question.joint)
        shape = (SAMPLES, len(region.lower))
        points = np.where(generator.integers(0, 2, shape) == 1, region.upper, region.lower)
        values = self._values(question, points)
        point, value = points[np.argmax(values)], float(values.max())
        for _ in range(SWEEPS):
            for index in sorted(self.used(question.state, question.joint)):
                tried = np.linspace(region.lower[index], region.upper[index], VALUES)
                tried = np.unique(np.floor(tried)) if index in region.counted else tried
                moved = np.tile(point, (len(tried), 1))
                moved[:, index] = tried
                values = self._values(question, moved)
                if values.max() > value:
                    point, value = moved[np.argmax(values)], float(values.max())
        return point, value

    def _values(self, question: BoundQuery, quantities: Array) -> Array:
        """Evaluates what is asked (m,), of quantities (m, n), for the joint alone."""
        policy, joint = self._policy, question.joint
        added = policy.tree_values(self._observed(quantities), joint)
        action = added.sum(axis=-1) + policy.intercepts[joint]
        values = self._policy.robot.default_stance[joint] + self._policy.robot.action_scale * action
        if question.of == "offset":
            values = values - quantities[..., self._positions[joint]]
        return question.sign * values

    def _observed(self, quantities: Array) -> Array:
        return (quantities - self._units.offset) * self._units.scale
