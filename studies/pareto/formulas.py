"""The formulas whose sizes are compared, each family fitted by least squares alone."""

from collections.abc import Callable
from dataclasses import dataclass

from glassgait.models.policies.expression import Expression
from glassgait.models.policies.quantities import Vocabulary
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.studies.students.dataset import Dataset
from glassgait.studies.students.formula_fit import gates, shared_gates
from glassgait.studies.students.student import TrainingSet
from glassgait.studies.students.symbolic import fit_policy
from glassgait.studies.students.symbolic_settings import SymbolicSettings

LENGTHS = (2, 4, 6, 8, 12, 16, 24, 32, 48, 64, 90, 120)
"""Greatest lengths of a joint's formula, in nodes; a weighted sum of k observations has 2k."""


@dataclass(frozen=True)
class Family:
    """A shape of formula.

    Attributes:
        title: What tables call it.
        gates: Returns what tells where in the gait the robot is.
        statewise: Whether a joint has a formula for each state of the machine.
    """

    title: str
    gates: Callable[[Vocabulary], tuple[Expression, ...]]
    statewise: bool = False

    def fit(self, gait: str, names: tuple[str, ...], data: Dataset, length: int) -> FormulaPolicy:
        """Fits formulas of at most `length` nodes to samples."""
        settings = SymbolicSettings(shapes=((length, length),))
        samples = TrainingSet(gait, names, data.observations, data.actions, data.starts)
        return fit_policy(samples, self.gates, settings, statewise=self.statewise)


def _no_gates(vocabulary: Vocabulary) -> tuple[Expression, ...]:
    return ()


FAMILIES = {
    "linear": Family("weighted sum", _no_gates),
    "gated": Family("gated sum", shared_gates),
    "statewise_linear": Family("weighted sum per RM state", _no_gates, statewise=True),
    "statewise_gated": Family("gated sum per RM state", gates, statewise=True),
}
