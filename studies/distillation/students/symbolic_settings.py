"""Settings of symbolic regression."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Annotated, ClassVar, Literal

from annotated_types import Ge, MinLen

from glassgait.models.errors import InputError
from glassgait.models.settings import DISTINCT, FEW, Count, Natural
from glassgait.studies.distillation.students.student import Candidate, StudentSettings

Engine = Literal["operon", "pysr"]
"""What searches formulas."""

Shape = tuple[int, int]
"""Lengths of the sum that a formula starts from, and of the whole formula (nodes)."""


@dataclass(frozen=True)
class SymbolicSettings(StudentSettings):
    """Settings of symbolic regression.

    Attributes:
        engine: `operon` works everywhere; `pysr` is the paper's and needs Julia.
        max_length: Greatest length of a formula in nodes, the paper's overall complexity (pysr).
            Lengths are as the engine counts: to Operon a weighted observation is one node, to PySR
            it is three.
        operator_complexity: Greatest length of what a function or a product is applied to, in
            nodes; sums are free (pysr).
        iterations: Iterations of the search (pysr).
        generations: Generations of the search (operon).
        population: Formulas in a generation (operon).
        coefficient_iterations: Steps of least squares on a new formula's coefficients (operon).
        shapes: Lengths of the sum that a formula starts from and of the whole formula, of which
            equal ones leave nothing to the engine (operon). Rounds take the first.
        start_weights: How often a sample of an episode's start counts. Rounds, and PySR, take the
            first.
        max_samples: Samples that the search sees, drawn evenly (operon).
        alone_episodes: Episodes of a round in which formulas act alone.
    """

    title: ClassVar[str] = "distillation: symbolic"

    engine: Engine = "operon"
    max_length: Annotated[Count, Ge(7)] = 90
    operator_complexity: Count = 4
    iterations: Count = 20
    generations: Count = 100
    population: Annotated[Count, Ge(2)] = 200
    coefficient_iterations: Natural = 3
    shapes: Annotated[tuple[Shape, ...], MinLen(1), FEW] = ((90, 90), (64, 64), (74, 90))
    start_weights: Annotated[tuple[Count, ...], MinLen(1), FEW, DISTINCT] = (1, 20)
    max_samples: Count = 3000
    alone_episodes: Count = 13  # type: ignore[assignment]

    def __post_init__(self) -> None:
        super().__post_init__()
        for sum_length, length in self.shapes:
            if not 1 <= sum_length <= length:
                raise InputError(
                    f"{self.title}: the shape {sum_length} {length} asks for a sum longer than its "
                    "formula, or for none; name the sum's length first"
                )

    def candidates(self) -> Sequence[Candidate]:
        """Lists every shape with every weight of the starts."""
        if self.engine == "pysr":
            return ()
        return [
            Candidate(
                _title(shape, weight),
                replace(self, shapes=(shape,), start_weights=(weight,)),
                # Of equal length, a longer sum leaves less to the engine, whose terms are harder
                # to read.
                (shape[1], -shape[0]),
            )
            for shape, weight in product(self.shapes, self.start_weights)
        ]


@dataclass(frozen=True)
class StatewiseSymbolicSettings(SymbolicSettings):
    """Settings of symbolic regression, where a joint has a formula for each state of the machine.

    Rounds take the smallest shape: it strays furthest, and samples of where it goes serve the
    larger.
    """

    title: ClassVar[str] = "distillation: statewise_symbolic"

    shapes: Annotated[tuple[Shape, ...], MinLen(1), FEW] = (
        (64, 64),
        (90, 90),
        (120, 120),
        (200, 200),
    )


def _title(shape: Shape, start_weight: int) -> str:
    sum_length, length = shape
    title = f"sum of {sum_length}, {length} in all"
    return title if start_weight == 1 else f"{title}, starts count {start_weight}"
