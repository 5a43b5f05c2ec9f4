"""The same policy in several physics: is what it learned true beyond its training solver?"""

from collections.abc import Callable, Sequence

import pandas as pd

from models.task.gait import Gait
from studies.evaluation.config import WORLDS, RolloutConfig
from studies.evaluation.rollouts import Team, roll_out
from studies.evaluation.scores import score_rollouts


def evaluate_worlds(
    gait: Gait,
    team: Team,
    worlds: Sequence[str],
    config: RolloutConfig,
    report: Callable[[str], None],
) -> pd.DataFrame:
    """Rolls a team out in each world.

    Returns:
        Scores, a row a robot, with the column `world`.
    """
    tables = []
    for name in worlds:
        world = WORLDS[name]
        report(f"rolling out in {world.title}")
        scores = score_rollouts(roll_out(gait, team, world, config))
        scores.insert(0, "world", world.title)
        tables.append(scores)
    return pd.concat(tables, ignore_index=True)
