"""The formulas whose sizes are compared."""

from collections.abc import Sequence
from dataclasses import dataclass

from glassgait.models.formulas.quantities import Vocabulary, known_definitions
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.studies.distillation.students.sparse_formula import condense, written_places
from glassgait.studies.distillation.students.student import TrainingSet

TERMS = (30, 40, 50, 70, 100, 140, 200, 300)
"""Numbers of terms of all formulas together."""


@dataclass(frozen=True)
class Family:
    """A way to make formulas.

    Attributes:
        title: What tables call it.
        mirrored: Whether formulas of one side are mirror images of the other's.
        refined: Whether their numbers learn on in closed loop.
    """

    title: str
    mirrored: bool
    refined: bool = False

    def fewest_terms(self, samples: TrainingSet) -> int:
        """Returns the fewest terms that there can be: one for each formula that is written."""
        names = samples.observation_names
        vocabulary = Vocabulary(names, known_definitions(samples.robot, names))
        return len(written_places(vocabulary, samples.mirror if self.mirrored else None))

    def fit(self, samples: TrainingSet, n_terms: int) -> FormulaPolicy:
        """Fits formulas of so many terms to samples."""
        return condense(samples, n_terms, mirrored=self.mirrored)


FAMILIES = {
    "mirrored": Family("mirrored", mirrored=True),
    "unmirrored": Family("unmirrored", mirrored=False),
    "refined": Family("mirrored, refined", mirrored=True, refined=True),
}


def families_of(samples: TrainingSet, *, refined: bool) -> dict[str, Family]:
    """Returns the families that there are for a gait.

    Args:
        samples: The samples that formulas are fitted to.
        refined: Whether there are refined ones.
    """
    return {
        name: family
        for name, family in FAMILIES.items()
        if (samples.mirror or not family.mirrored) and (refined or not family.refined)
    }


def sizes_of(family: Family, samples: TrainingSet, terms: Sequence[int]) -> list[int]:
    """Leaves, of numbers of terms, those that a family can have."""
    return [n_terms for n_terms in terms if n_terms >= family.fewest_terms(samples)]
