"""Finding the expert of a gait where a person names none."""

from pathlib import Path

from glassgait.models.policies.library import load_expert, policy_path, shipped_experts
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.robots.robot import DEFAULT_ROBOT, load_robot, robot_folder
from glassgait.models.task.gait import Gait
from glassgait.studies.common.console import note

TRAINING_FOLDER = Path("runs/training")


def find_expert(gait: Gait, path: Path | None = None, robot: str | None = None) -> NeuralPolicy:
    """Loads the expert of a gait, and notes which, where that is not the shipped one.

    Args:
        gait: The gait.
        path: The expert's file; by default the shipped one, and where none ships, what
            `glassgait train` keeps in runs/training/<gait>, of another robot than the default
            one in runs/training/<robot>/<gait>.
        robot: Name of the robot, or path of its robot.yaml; by default that of the file, and of
            what ships the default one.

    Raises:
        InputError: if there is no expert, or the file holds something else, or the expert of
            another gait.
    """
    own = load_robot(robot or DEFAULT_ROBOT)
    if path is not None:
        return load_expert(gait, path, own if robot else None)
    if gait.name not in shipped_experts(own.name):
        folder = robot_folder(TRAINING_FOLDER, own.name) / gait.name
        trained = policy_path(folder, gait.name)
        if trained.exists():
            note(f"expert: {trained}, since none of the {gait.name} ships")
            path = trained
    return load_expert(gait, path, own)
