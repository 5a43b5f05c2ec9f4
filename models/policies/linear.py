"""Linear policies: one weight vector a joint, or one a joint and state of the reward machine."""

from typing import ClassVar

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.policies.arrays import Reals
from glassgait.models.policies.capabilities import Capabilities, FactoredTerm, weighted_terms
from glassgait.models.policies.policy import (
    INTERCEPT,
    Contributions,
    Policy,
    contributions_of_action,
)
from glassgait.models.robots.robot import Robot
from glassgait.models.task.observation import machine_state_entries


def _factors(policy: "LinearPolicy", joint: int) -> tuple[FactoredTerm, ...]:
    weights = [(weight,) for weight in (policy.robot.action_scale * policy.weights[joint]).tolist()]
    intercept = (
        policy.robot.default_stance[joint] + policy.robot.action_scale * policy.intercepts[joint]
    )
    return weighted_terms((float(intercept),), weights)


def _statewise_factors(policy: "StatewiseLinearPolicy", joint: int) -> tuple[FactoredTerm, ...]:
    scale, stance = policy.robot.action_scale, policy.robot.default_stance[joint]
    weights = [tuple(own) for own in (scale * policy.weights[:, joint]).T.tolist()]
    intercepts = stance + scale * policy.intercepts[:, joint]
    return weighted_terms(tuple(intercepts.tolist()), weights)


def _importance(policy: "LinearPolicy", observations: Array) -> tuple[str, Array]:
    return "derivatives", np.abs(policy.weights) * observations.std(axis=0)


def _statewise_importance(
    policy: "StatewiseLinearPolicy", observations: Array
) -> tuple[str, Array]:
    share = policy.state_shares(observations)
    slopes = np.tensordot(share, np.abs(policy.weights), axes=1)
    return "derivatives", slopes * observations.std(axis=0)


class LinearPolicy(Policy):
    """Each action is a weighted sum of the observations.

    Attributes:
        weights: Weights (12, n).
        intercepts: Intercepts (12,).
    """

    kind = "linear"
    capabilities = Capabilities(
        factors=_factors,
        importance=_importance,
        targets="certificates.formula_targets:FormulaTargets.of_linear",
        search="counterfactuals.smooth:SmoothSearch.of_linear",
        code="export.policies:linear_code",
        graph="export.graphs.policies:add_linear",
    )
    array_specs: ClassVar = {"weights": Reals("joints observations"), "intercepts": Reals("joints")}
    weights: Array
    intercepts: Array

    def __init__(
        self,
        gait: str,
        observation_names: tuple[str, ...],
        weights: Array,
        intercepts: Array,
        *,
        robot: Robot | None = None,
    ) -> None:
        super().__init__(
            gait, observation_names, robot=robot, weights=weights, intercepts=intercepts
        )

    def __call__(self, observation: Array) -> Array:
        return observation @ self.weights.T + self.intercepts

    def _explain(self, observation: Array, joint: int) -> Contributions:
        intercepts = np.full(observation.shape[:-1], self.intercepts[joint])
        parts = self.weights[joint] * observation
        return _contributions(self, intercepts, parts, joint)


class StatewiseLinearPolicy(Policy):
    """A linear policy for each state of the reward machine: a hybrid automaton to read.

    Attributes:
        weights: Weights (n_states, 12, n).
        intercepts: Intercepts (n_states, 12).
    """

    kind = "statewise_linear"
    capabilities = Capabilities(
        factors=_statewise_factors,
        importance=_statewise_importance,
        targets="certificates.formula_targets:FormulaTargets.of_linear",
        search="counterfactuals.smooth:SmoothSearch.of_linear",
        code="export.policies:linear_code",
        graph="export.graphs.policies:add_statewise_linear",
    )
    array_specs: ClassVar = {
        "weights": Reals("states joints observations"),
        "intercepts": Reals("states joints"),
    }
    needed_groups = ("machine state",)
    weights: Array
    intercepts: Array

    def __init__(
        self,
        gait: str,
        observation_names: tuple[str, ...],
        weights: Array,
        intercepts: Array,
        *,
        robot: Robot | None = None,
    ) -> None:
        super().__init__(
            gait, observation_names, robot=robot, weights=weights, intercepts=intercepts
        )
        self._one_hot = machine_state_entries(observation_names)

    def __call__(self, observation: Array) -> Array:
        state = np.argmax(observation[..., self._one_hot], axis=-1)
        weights = self.weights[state]
        return np.einsum("...jn,...n->...j", weights, observation) + self.intercepts[state]

    def state_shares(self, observations: Array) -> Array:
        """Returns the share of observations (m, n) in each state of the machine (n_states,)."""
        return observations[:, self._one_hot].mean(axis=0)

    def _explain(self, observation: Array, joint: int) -> Contributions:
        state = np.argmax(observation[..., self._one_hot], axis=-1)
        parts = self.weights[state, joint] * observation
        intercepts = self.intercepts[state, joint]
        return _contributions(self, intercepts, parts, joint)


def _contributions(policy: Policy, intercepts: Array, parts: Array, joint: int) -> Contributions:
    values = np.concatenate([intercepts[..., None], parts], axis=-1)
    terms = INTERCEPT, *policy.observation_names
    return contributions_of_action(policy.robot, terms, values, joint)
