"""The scorecard: each gait's expert, or a student, in every world."""

from collections.abc import Sequence

from models.task.gait import Gait
from studies.evaluation.config import WORLDS, RolloutConfig, WorldName
from studies.evaluation.jobs import RolloutJob, for_each_seed
from studies.evaluation.team import Team

_SLOWEST_FIRST = ("cenic_1e-5", "lagged_0.5ms", "similar_1ms", "sap_2ms")


def scorecard_jobs(
    teams: Sequence[tuple[Gait, Team]], worlds: Sequence[WorldName], config: RolloutConfig
) -> list[RolloutJob]:
    """Lists the rollouts of every gait's team in every world, the slow worlds first."""
    slow = [world for world in _SLOWEST_FIRST if world in worlds]
    ordered = [*slow, *(world for world in worlds if world not in slow)]
    return [
        job
        for world in ordered
        for gait, team in teams
        for job in for_each_seed(
            RolloutJob({"gait": gait.name, "world": world}, gait, team, WORLDS[world], config)
        )
    ]
