"""A page of formulas: so few terms in all that a person reads them at one sitting."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from annotated_types import Ge

from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.settings import Count
from glassgait.studies.distillation.students.student import Student, StudentSettings, TrainingSet
from glassgait.studies.distillation.students.term_pursuit import condense


@dataclass(frozen=True)
class SparseFormulaSettings(StudentSettings):
    """Settings of a page of formulas.

    Attributes:
        terms: Terms of all formulas together, the constant of each among them; a formula's mirror
            image costs none.
        mirrored: Whether formulas of one side are mirror images of the other's, where the gait's
            machine has a mirror image.
        alone_episodes: Episodes of a round in which the page acts alone.
    """

    title: ClassVar[str] = "distillation: sparse_formula"

    terms: Annotated[Count, Ge(12)] = 100
    mirrored: bool = True
    alone_episodes: Count = 13  # type: ignore[assignment]


def _fit(
    samples: TrainingSet, settings: SparseFormulaSettings, *, seed: int, n_jobs: int
) -> FormulaPolicy:
    return condense(samples, settings.terms, mirrored=settings.mirrored)


SPARSE_FORMULA = Student(
    "sparse_formula",
    "Page of formulas",
    _fit,
    color="#E69F00",
    marker="*",
    settings=SparseFormulaSettings(),
    brevity=1,
)
