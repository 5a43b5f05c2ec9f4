"""Ways to make formulas, of which a front has a curve each."""

from collections.abc import Sequence
from dataclasses import dataclass

from glassgait.models.formulas.quantities import Vocabulary, known_definitions
from glassgait.studies.distillation.students.formula_samples import written_places
from glassgait.studies.distillation.students.sparse_formula import possible_terms
from glassgait.studies.distillation.students.student import TrainingSet


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

    def possible_terms(self, samples: TrainingSet) -> range:
        """Returns the numbers of terms that the formulas that are written can have in all."""
        names = samples.observation_names
        vocabulary = Vocabulary(names, known_definitions(samples.robot, names))
        places = written_places(vocabulary, samples.mirror if self.mirrored else None)
        return possible_terms(len(places))


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
    possible = family.possible_terms(samples)
    return [n_terms for n_terms in terms if n_terms in possible]
