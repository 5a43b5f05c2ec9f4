"""The formulas whose sizes are compared, each family fitted by least squares alone."""

from collections.abc import Callable
from dataclasses import dataclass

from glassgait.models.policies.expression import Expression
from glassgait.models.policies.gates import statewise_symbolic_gates, symbolic_gates
from glassgait.models.policies.symbolic import (
    FormulaPolicy,
    StatewiseSymbolicPolicy,
    SymbolicPolicy,
)
from glassgait.studies.students.dataset import Dataset
from glassgait.studies.students.gated_sum import fit_gated_sums
from glassgait.studies.students.student import TrainingSet

LENGTHS = (2, 4, 6, 8, 12, 16, 24, 32, 48, 64, 90, 120)
"""Greatest lengths of a joint's formula, in nodes; a weighted sum of k observations has 2k."""


@dataclass(frozen=True)
class Family:
    """A shape of formula.

    Attributes:
        title: What tables call it.
        gates: Returns what tells where in the gait the robot is, given the observations' names.
        statewise: Whether a joint has a formula for each state of the machine.
    """

    title: str
    gates: Callable[[tuple[str, ...]], tuple[Expression, ...]]
    statewise: bool = False

    def fit(self, gait: str, names: tuple[str, ...], data: Dataset, length: int) -> FormulaPolicy:
        """Fits formulas of at most `length` nodes to samples."""
        gates = self.gates(names)
        if not self.statewise:
            formulas = fit_gated_sums(data.observations, data.actions, gates, length)
            return SymbolicPolicy(gait, names, formulas)
        by_state = [
            fit_gated_sums(data.observations[mine], data.actions[mine], gates, length)
            for mine in TrainingSet(
                gait, names, data.observations, data.actions, data.starts
            ).by_state()
        ]
        return StatewiseSymbolicPolicy(gait, names, by_state)


def _no_gates(names: tuple[str, ...]) -> tuple[Expression, ...]:
    return ()


FAMILIES = {
    "linear": Family("weighted sum", _no_gates),
    "gated": Family("gated sum", symbolic_gates),
    "statewise_linear": Family("weighted sum per RM state", _no_gates, statewise=True),
    "statewise_gated": Family("gated sum per RM state", statewise_symbolic_gates, statewise=True),
}
