"""Reward against alternation ratio, for the expert and every student (paper, Figure 2)."""

from collections.abc import Mapping

from glassgait.diagrams.scenario import Scenario
from glassgait.models.policies.controller import AlternatingController, alone
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.task.alternation import ratio_title
from glassgait.models.task.gait import Gait
from glassgait.studies.common.cases import Case
from glassgait.studies.common.rollouts.config import RolloutConfig
from glassgait.studies.common.rollouts.scoring import rollout_cases

PERIODS = (1, 2, 4, 6, 8, 0)
"""Control steps from one action of the expert to the next: ratios 1, 1/2, 1/4, 1/6, 1/8 and 0."""


def alternation_cases(
    gait: Gait,
    expert: NeuralPolicy,
    students: Mapping[str, Policy],
    config: RolloutConfig,
    periods: tuple[int, ...] = PERIODS,
    scenario: Scenario | None = None,
) -> list[Case]:
    """Lists the rollouts of every student at every ratio, in the training world by default.

    All meet the same initial states, commands and noise. At ratio 1 the expert acts alone, so it
    is rolled out once.
    """
    scenario = scenario or Scenario()
    config = config.at_distilled_speeds(gait, scenario)
    policies = {("expert", 1): alone(expert)}
    for kind, student in students.items():
        for period in periods:
            if period != 1:
                policies[kind, period] = AlternatingController(expert, student, period)
    return [
        job
        for (kind, period), policy in policies.items()
        for job in rollout_cases(
            {"policy": kind, "ratio": ratio_title(period)},
            gait,
            policy,
            scenario,
            config,
        )
    ]
