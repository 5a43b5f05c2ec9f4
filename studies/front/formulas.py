"""The formulas whose sizes are compared, each family fitted by least squares alone."""

from collections.abc import Callable
from dataclasses import dataclass

from models.policies.policy import Policy
from models.policies.symbolic import StatewiseSymbolicPolicy, SymbolicPolicy
from studies.distillation.collection import Dataset, samples_by_state
from studies.distillation.gated_sum import fit_gated_sums, machine_gates

Fit = Callable[[str, tuple[str, ...], Dataset, int], Policy]

LENGTHS = (2, 4, 6, 8, 12, 16, 24, 32, 48, 64, 90)
"""Greatest lengths of a joint's formula, in nodes; a weighted sum of k observations has 2k."""


@dataclass(frozen=True)
class Family:
    """A shape of formula.

    Attributes:
        title: What tables call it.
        fit: Fits a policy of the family to samples, given gait, names and greatest length.
    """

    title: str
    fit: Fit


def _fit_linear(gait: str, names: tuple[str, ...], data: Dataset, length: int) -> Policy:
    return SymbolicPolicy(gait, names, fit_gated_sums(data.observations, data.actions, (), length))


def _fit_gated(gait: str, names: tuple[str, ...], data: Dataset, length: int) -> Policy:
    formulas = fit_gated_sums(data.observations, data.actions, machine_gates(names), length)
    return SymbolicPolicy(gait, names, formulas)


def _fit_statewise(gait: str, names: tuple[str, ...], data: Dataset, length: int) -> Policy:
    formulas = [
        fit_gated_sums(data.observations[mine], data.actions[mine], (), length)
        for mine in samples_by_state(data.observations, names)
    ]
    return StatewiseSymbolicPolicy(gait, names, formulas)


FAMILIES = {
    "linear": Family("weighted sum", _fit_linear),
    "gated": Family("gated sum", _fit_gated),
    "statewise": Family("weighted sum per RM state", _fit_statewise),
}
