"""Walks: robots that a policy drives alone, what they saw, and how they followed commands."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from glassgait.diagrams.scenario import Scenario
from glassgait.models.arrays import Array
from glassgait.models.policies.controller import alone
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import indices_of, machine_state_entries
from glassgait.models.task.symmetry import reflect_observation
from glassgait.studies.common.observers import Observations
from glassgait.studies.common.rollouts import RolloutConfig, roll_out
from glassgait.studies.common.scores import score_rollouts


@dataclass(frozen=True)
class Walk:
    """What robots saw at each control step, and where the step led.

    Where a policy's file has a mirror image, the same steps follow once more as a mirror shows
    them: a formula that is written for one side is then seen at work on both.

    Attributes:
        quantities: Variables of the formulas (T, n, k).
        state: State of the machine (T, n).
        angle: Joint angles that the step led to, as sensors measure them (T, n, 12; rad).
        alive: Whether the robot was up to the step's end (T, n).
        image: Whether a step is one seen in the mirror (T,).
        scores: How robots did, a row a robot, as `score_rollouts` returns.
    """

    quantities: Array
    state: NDArray[np.int64]
    angle: Array
    alive: NDArray[np.bool_]
    image: NDArray[np.bool_]
    scores: pd.DataFrame

    @cached_property
    def falls(self) -> int:
        """Number of robots that fell."""
        return int(self.scores["fell"].sum())


def walk(
    gait: Gait, expert: NeuralPolicy | None, policy: FormulaPolicy, config: RolloutConfig
) -> Walk:
    """Lets a policy walk alone in the training scenario.

    Equal seeds give equal starts, commands and noise, whatever the policy does.

    Args:
        expert: The expert; its estimator observes for a policy that has none of its own.
        config: How many robots walk, for how long (2 control steps or more), and of which seed.
    """
    controller, observations = alone(policy, expert), Observations()
    log = roll_out(gait, controller, Scenario(), config, observers=[observations])
    observed = observations.array
    fell = np.logical_or.accumulate(log.failures.any(axis=2), axis=0)
    return seen_by(policy, observed, ~fell[: len(observed)], score_rollouts(log, policy.robot.mass))


def seen_by(
    policy: FormulaPolicy, observed: Array, alive: NDArray[np.bool_], scores: pd.DataFrame
) -> Walk:
    """Returns what a policy's robots observed, and in the mirror if its file has an image there.

    Args:
        observed: What robots observed (T + 1, n, N).
        alive: Whether each was up after the step (T + 1, n).
        scores: How they did, a row a robot.

    Returns:
        The first T steps: the last one's outcome was never observed.
    """
    views = [observed]
    if policy.mirror is not None:
        views.append(reflect_observation(policy.observation_names, policy.mirror)(observed))
    quantities = [policy.quantities(view) for view in views]
    angles = list(indices_of("joint position", policy.observation_names))
    one_hot = machine_state_entries(policy.observation_names)
    before = np.concatenate([seen[:-1] for seen in quantities])
    return Walk(
        quantities=before,
        state=np.argmax(before[..., one_hot], axis=-1),
        angle=np.concatenate([seen[1:][..., angles] for seen in quantities]),
        alive=np.concatenate([alive[:-1]] * len(views)),
        image=np.repeat(np.arange(len(views)) > 0, len(observed) - 1),
        scores=scores,
    )
