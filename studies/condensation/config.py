"""The settings of a condensation."""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

import tyro
from annotated_types import Ge, Le

from glassgait.diagrams.worlds import Worlds
from glassgait.models.settings import Count, Natural, Seed, Settings


@dataclass(frozen=True)
class CondensationConfig(Settings):
    """How a page of formulas is made.

    Attributes:
        terms: Terms of all formulas together, the constant of each among them; a formula's mirror
            image costs none.
        mirrored: Whether formulas of one side are mirror images of the other's, where the gait's
            machine has a mirror image.
        alone_rounds: Rounds in which the formulas act alone, after a first one of the expert's.
        n_robots: Robots of a round, each in a world of its own.
        n_steps: Control steps of a round.
        worlds: The worlds of the samples: those that experts learn in.
        seed: Seed of all randomness.
    """

    title: ClassVar[str] = "condensation"

    terms: Annotated[Count, Ge(48)] = 100
    mirrored: bool = True
    alone_rounds: Natural = 6
    n_robots: Annotated[Count, Le(16)] = 16
    n_steps: Annotated[Count, Ge(2)] = 400
    worlds: Annotated[Worlds, tyro.conf.arg(name="worlds")] = field(default_factory=Worlds)
    seed: Seed = 0
