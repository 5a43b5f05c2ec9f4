"""The scorecard: each gait's expert, or a student, in every world."""

import math
from collections.abc import Sequence

from glassgait.models.task.gait import Gait
from glassgait.studies.evaluation.config import WORLDS, RolloutConfig, WorldName
from glassgait.studies.evaluation.jobs import RolloutJob, for_each_seed
from glassgait.studies.evaluation.team import Team


def scorecard_jobs(
    teams: Sequence[tuple[Gait, Team]], worlds: Sequence[WorldName], config: RolloutConfig
) -> list[RolloutJob]:
    """Lists the rollouts of every gait's team in every world, the slow worlds first.

    A student is asked for the speeds of distillation unless the settings name others.
    """
    # Where physics is slow, few robots are rolled out.
    ordered = sorted(worlds, key=lambda world: WORLDS[world].max_robots or math.inf)
    jobs = []
    for name in ordered:
        for gait, team in teams:
            own = config.at_distilled_speeds(gait) if team.student else config
            labels = {"gait": gait.name, "world": name}
            jobs += for_each_seed(RolloutJob(labels, gait, team, WORLDS[name], own))
    return jobs
