"""Where a policy goes by itself, with what the expert would do there."""

import numpy as np

from glassgait.diagrams.scenario import Scenario
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.task.gait import Gait
from glassgait.studies.common.rollouts.config import distilled_speeds
from glassgait.studies.distillation.collection import collect
from glassgait.studies.distillation.rounds import Round
from glassgait.studies.distillation.students.dataset import Dataset

N_SPEEDS = 4
"""Forward speeds that robots are given in turn, as in a distillation."""


def visit(
    gait: Gait, expert: NeuralPolicy, policy: Policy, *, n_robots: int, n_steps: int, seed: int
) -> Dataset:
    """Rolls a policy out alone in the training scenario; a robot that falls starts again.

    Forward speeds are those of a distillation, in turn; yaw rates are drawn to both sides alike.

    Args:
        gait: The gait.
        expert: The expert; its estimator observes for the policy.
        policy: The policy that acts: a student, or the expert.
        n_robots: Number of robots.
        n_steps: Control steps of each.
        seed: Seed of initial states, commands and noise.

    Returns:
        What the robots observed and the expert would do (n_robots · n_steps samples), each robot
        an episode.

    Raises:
        InputError: if a sample is not finite.
    """
    return collect(
        gait,
        expert,
        policy,
        plan=Round(number=1, period=0, episodes=range(1, n_robots + 1), steps=n_steps),
        speeds=np.linspace(*distilled_speeds(gait), N_SPEEDS),
        worlds=Scenario(),
        generator=np.random.default_rng(seed),
    )
