"""Playing one robot as fast as it goes, and keeping the replay."""

from pathlib import Path
from typing import Annotated

from annotated_types import Ge, Le
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram

from glassgait.diagrams.locomotion import LocomotionConfig, MakeLocomotion
from glassgait.diagrams.replay import save_replay
from glassgait.diagrams.rollout import Rollout, make_simulator, record
from glassgait.models.policies.alternating import AlternatingPolicy
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait

Seconds = Annotated[float, Ge(CONTROL_PERIOD), Le(3600.0)]
"""Length of a rollout (s): a step at least, and an hour at most, which the memory holds."""


def play(
    gait: Gait,
    policy: AlternatingPolicy,
    config: LocomotionConfig,
    meshcat: Meshcat,
    replay: Path,
    *,
    seconds: float,
    seed: int = 0,
) -> Rollout:
    """Rolls a policy out and writes the replay.

    Args:
        gait: The gait.
        policy: Who acts; its period is the alternation's.
        config: How the loop is closed.
        meshcat: Where the replay is drawn.
        replay: HTML file of the replay.
        seconds: Length of the rollout (s); a fall ends it before.
        seed: Seed of noise and drawn commands.

    Raises:
        InputError: if a policy or the command does not fit the gait.
    """
    diagram = make_shown(gait, policy, config, meshcat)
    rollout = record(make_simulator(diagram, seed=seed), round(seconds / CONTROL_PERIOD))
    save_replay(diagram, meshcat, rollout, replay)
    return rollout


def make_shown(
    gait: Gait, policy: AlternatingPolicy, config: LocomotionConfig, meshcat: Meshcat
) -> Diagram:
    """Closes the loop around a policy, in view of Meshcat.

    Raises:
        InputError: if a policy or the command does not fit the gait.
    """
    return MakeLocomotion(
        gait,
        config,
        expert=policy.acting_expert,
        student=policy.acting_student,
        estimator=policy.expert.estimator,
        meshcat=meshcat,
    )
