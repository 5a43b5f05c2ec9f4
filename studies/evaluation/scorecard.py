"""The scorecard: each gait's expert, or a student, in every scenario."""

import math
from collections.abc import Mapping, Sequence

from glassgait.diagrams.scenario import Scenario
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.task.gait import Gait
from glassgait.studies.common.rollouts.config import RolloutConfig
from glassgait.studies.common.rollouts.jobs import RolloutJob, for_each_seed


def scorecard_jobs(
    policies: Sequence[tuple[Gait, AlternatingController]],
    scenarios: Mapping[str, Scenario],
    config: RolloutConfig,
) -> list[RolloutJob]:
    """Lists the rollouts of every gait's policy in every scenario, the slow ones first.

    A student is asked for the speeds of distillation unless the settings or the scenario name
    others.
    """
    # Where physics is slow, few robots are rolled out.
    ordered = sorted(scenarios.items(), key=lambda item: item[1].max_robots or math.inf)
    jobs = []
    for name, scenario in ordered:
        for gait, policy in policies:
            own = config.at_distilled_speeds(gait, scenario) if policy.student else config
            labels = {"gait": gait.name, "scenario": name}
            jobs += for_each_seed(RolloutJob(labels, gait, policy, scenario, own))
    return jobs
