"""What experiments that push walking robots share."""

from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar

from annotated_types import Ge, Gt, Le

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.scenario import Scenario
from glassgait.models.settings import Count
from glassgait.studies.common.cases import Case
from glassgait.studies.common.experiment import Experiment

PushSpeed = Annotated[float, Gt(0.0), Le(20.0)]

Phases = Annotated[Count, Le(1000)]

Steps = Annotated[int, Ge(50), Le(450)]
"""Control steps from the push to the end: a second at least, in which a robot must walk; after ten
comes a new command."""


@dataclass(frozen=True)
class PushExperiment(Experiment):
    """Pushes walking robots, one in each phase of the gait's cycle, and looks which walk on.

    Attributes:
        command: What the robots are commanded.
        n_phases: Instants of the gait's cycle in which robots are pushed.
        n_steps: Control steps from the push until a robot must still walk.
    """

    one: ClassVar[tuple[str, ...]] = ("scenario",)
    discrete: ClassVar[bool] = True
    n_robots: ClassVar[int] = 1
    n_seeds: ClassVar[int] = 1

    command: FixedCommand = field(default_factory=FixedCommand)
    n_phases: Phases = 8
    n_steps: Steps = 250

    def commanded(self, case: Case) -> Scenario:
        """Returns the scenario of a case, with the command that all its robots follow."""
        return replace(case.scenario, command=self.command)
