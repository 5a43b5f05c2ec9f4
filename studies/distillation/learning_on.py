"""Settings of a run in which what walks already learns on."""

from dataclasses import replace
from typing import Any

from glassgait.diagrams.domain_randomization import DomainRandomization
from glassgait.models.robots.joint_law import JointLaw
from glassgait.models.robots.library import load_robot
from glassgait.studies.training.config import CurriculumConfig, TrainingConfig

FULL_DEMANDS = CurriculumConfig(initial_difficulty=1.0, initial_hardship=1.0)
"""No curriculum: the whole dwell, clearance, pushes and ground from the first update on."""


def learning_on(
    worlds: DomainRandomization, *, robot: str, law: JointLaw, **settings: Any
) -> TrainingConfig:
    """Returns the settings of a run in which what walks already learns on.

    Args:
        worlds: The randomised scenarios that it walks in.
        robot: Name of the robot, or path of its robot.yaml.
        law: How joints follow targets.
        settings: More of the training's settings.

    Raises:
        InputError: if there are too few robots for an update, or for the worlds' groups.
    """
    station = worlds.station.with_gains(load_robot(robot), law)
    return TrainingConfig(
        robot=robot,
        worlds=replace(worlds, station=station),
        limit_targets=law.limited,
        curriculum=FULL_DEMANDS,
        **settings,
    )
