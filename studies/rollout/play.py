"""Playing one robot in Meshcat, and keeping the replay."""

from collections.abc import Callable
from pathlib import Path

from pydrake.geometry import Meshcat

from diagrams.locomotion import LocomotionConfig, MakeLocomotion
from diagrams.rollout import Rollout, make_simulator, record
from diagrams.visualization import save_replay, start_recording
from models.task import CONTROL_PERIOD
from models.task.gait import Gait
from studies.evaluation.team import Team


def play(
    gait: Gait,
    team: Team,
    config: LocomotionConfig,
    meshcat: Meshcat,
    replay: Path,
    *,
    seconds: float,
    seed: int = 0,
    realtime_rate: float = 0.0,
    stopped: Callable[[], bool] = lambda: False,
) -> Rollout:
    """Rolls a team out in view of Meshcat and writes the replay.

    Args:
        gait: The gait.
        team: Who acts; its period is the alternation's.
        config: How the loop is closed.
        meshcat: Where the robot shows.
        replay: HTML file of the replay.
        seconds: Length of the rollout (s); a fall ends it before.
        seed: Seed of noise and drawn commands.
        realtime_rate: Greatest speed in wall time; 0 is as fast as can be.
        stopped: Asked after every step whether to end now.
    """
    diagram = MakeLocomotion(
        gait,
        config,
        expert=team.acting_expert,
        student=team.acting_student,
        estimator=team.expert.estimator,
        meshcat=meshcat,
    )
    simulator = make_simulator(diagram, seed=seed, realtime_rate=realtime_rate)
    start_recording(meshcat)
    rollout = record(simulator, round(seconds / CONTROL_PERIOD), stopped=stopped)
    save_replay(meshcat, replay)
    return rollout
