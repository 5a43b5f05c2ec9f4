"""What the terms of a target are functions of, as the page names and counts it."""

from dataclasses import dataclass

import numpy as np

from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.task.observation import entries_of


@dataclass(frozen=True)
class Variables:
    """What a policy's terms are functions of, over a rollout.

    Attributes:
        titles: Their names (k).
        units: Their units (k).
        values: Their values (n_steps, k).
    """

    titles: tuple[str, ...]
    units: tuple[str, ...]
    values: np.ndarray


def variables_of(policy: Policy, observations: np.ndarray) -> Variables:
    """Returns what the terms of a policy are functions of.

    Args:
        policy: The policy.
        observations: What it observed (n_steps, n).
    """
    entries = entries_of(policy.observation_names)
    if not isinstance(policy, FormulaPolicy):
        units = tuple(entry.scaled_unit(policy.robot) for entry in entries)
        return Variables(policy.observation_names, units, observations)
    notes = (definition.note for definition in policy.vocabulary.definitions)
    units = (*(entry.unit for entry in entries), *notes)
    return Variables(policy.vocabulary.symbols, units, policy.quantities(observations))
