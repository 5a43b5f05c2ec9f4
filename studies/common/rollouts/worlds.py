"""Which robots are rolled out: those of every policy alone, in every world."""

import math
from collections.abc import Mapping

from glassgait.diagrams.scenario import Scenario
from glassgait.models.policies.controller import Controller, alone
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.task.gait import Gait
from glassgait.studies.common.rollouts.config import RolloutConfig
from glassgait.studies.common.rollouts.jobs import RolloutJob, for_each_seed


def world_jobs(
    gait: Gait,
    expert: NeuralPolicy,
    students: Mapping[str, Policy],
    scenarios: Mapping[str, Scenario],
    config: RolloutConfig,
) -> list[RolloutJob]:
    """Lists the rollouts of the expert and of every student alone, as `jobs_in_worlds` does."""
    policies = {"expert": alone(expert)}
    policies |= {kind: alone(student, expert) for kind, student in students.items()}
    return jobs_in_worlds(gait, policies, scenarios, config)


def jobs_in_worlds(
    gait: Gait,
    policies: Mapping[str, Controller],
    scenarios: Mapping[str, Scenario],
    config: RolloutConfig,
) -> list[RolloutJob]:
    """Lists the rollouts of every policy in every world, the slow ones first.

    In a world all policies meet the same initial states, commands and noise, at the speeds of
    distillation unless the settings or the scenario name others: robots can be compared in pairs.
    """
    # Where physics is slow, few robots are rolled out.
    ordered = sorted(scenarios.items(), key=lambda item: item[1].max_robots or math.inf)
    return [
        job
        for name, scenario in ordered
        for kind, policy in policies.items()
        for job in for_each_seed(
            RolloutJob(
                {"policy": kind, "scenario": name},
                gait,
                policy,
                scenario,
                config.at_distilled_speeds(gait, scenario),
            )
        )
    ]
