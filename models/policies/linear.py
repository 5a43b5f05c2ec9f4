"""Linear policies: one weight vector per joint, or per joint and RM state."""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.formulas.expression import variable
from glassgait.models.policies.policy import (
    INTERCEPT,
    ArraySpec,
    Contributions,
    FactoredTerm,
    Policy,
    Reals,
    contributions_of_action,
)
from glassgait.models.robots import quadruped
from glassgait.models.task.observation import symbols_of


class LinearPolicy(Policy):
    """Each action is a weighted sum of the observations: weights (12, n), intercepts (12,)."""

    kind = "linear"
    array_specs: ClassVar[Mapping[str, ArraySpec]] = {
        "weights": Reals("joints observations"),
        "intercepts": Reals("joints"),
    }
    weights: Array
    intercepts: Array

    def act(self, observation: Array) -> Array:
        return observation @ self.weights.T + self.intercepts

    def by_state(self) -> tuple[Array, Array]:
        """Returns weights (k, 12, n) and intercepts (k, 12); k is 1 if all RM states share them."""
        return self.weights[None], self.intercepts[None]

    def factored_terms(self, joint: int) -> tuple[FactoredTerm, ...]:
        scale, stance = self.robot.action_scale, self.robot.default_stance[joint]
        # A target is the stance plus the scaled action.
        weights, intercepts = self.by_state()
        constant = tuple((stance + scale * intercepts[:, joint]).tolist())
        slopes = (scale * weights[:, joint]).T.tolist()
        return (
            FactoredTerm(constant, ()),
            *(FactoredTerm(tuple(slope), (variable(i),)) for i, slope in enumerate(slopes)),
        )

    def importance(self, observations: Array) -> tuple[str, Array]:
        slopes = np.tensordot(self._state_shares(observations), np.abs(self.by_state()[0]), axes=1)
        return "derivatives", slopes * observations.std(axis=0)

    def _state_shares(self, observations: Array) -> Array:
        """Returns the share of observations (m, n) to which each entry of `by_state` applies."""
        return np.ones(1)

    def explain(self, observation: Array, joint: int | str) -> Contributions:
        joint = quadruped.joint_index(joint)
        weights, intercepts = (array[:, joint] for array in self.by_state())
        state = self.machine_state(observation) if len(weights) > 1 else 0
        products = weights[state] * observation
        constant = np.broadcast_to(intercepts[state], observation.shape[:-1])[..., None]
        values = np.concatenate([constant, products], axis=-1)
        terms = INTERCEPT, *symbols_of(self.observation_names)
        return contributions_of_action(self.robot, terms, values, joint)


class LinearPerStatePolicy(LinearPolicy):
    """A linear policy for each RM state: weights (n_states, 12, n), intercepts (n_states, 12)."""

    kind = "linear_per_state"
    array_specs: ClassVar[Mapping[str, ArraySpec]] = {
        "weights": Reals("states joints observations"),
        "intercepts": Reals("states joints"),
    }

    def act(self, observation: Array) -> Array:
        state = self.machine_state(observation)
        weights = self.weights[state]
        return np.einsum("...jn,...n->...j", weights, observation) + self.intercepts[state]

    def by_state(self) -> tuple[Array, Array]:
        return self.weights, self.intercepts

    def _state_shares(self, observations: Array) -> Array:
        return observations[:, self._one_hot].mean(axis=0)
