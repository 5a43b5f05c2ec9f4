"""The scorecard: each gait's expert, or a student, in every world."""

import math
from collections.abc import Sequence

from glassgait.models.policies.alternating import AlternatingPolicy
from glassgait.models.task.gait import Gait
from glassgait.studies.rollouts.config import WORLDS, RolloutConfig, WorldName
from glassgait.studies.rollouts.jobs import RolloutJob, for_each_seed


def scorecard_jobs(
    policies: Sequence[tuple[Gait, AlternatingPolicy]],
    worlds: Sequence[WorldName],
    config: RolloutConfig,
) -> list[RolloutJob]:
    """Lists the rollouts of every gait's policy in every world, the slow worlds first.

    A student is asked for the speeds of distillation unless the settings name others.
    """
    # Where physics is slow, few robots are rolled out.
    ordered = sorted(worlds, key=lambda world: WORLDS[world].max_robots or math.inf)
    jobs = []
    for name in ordered:
        for gait, policy in policies:
            own = config.at_distilled_speeds(gait) if policy.student else config
            labels = {"gait": gait.name, "world": name}
            jobs += for_each_seed(RolloutJob(labels, gait, policy, WORLDS[name], own))
    return jobs
