"""Finding the expert of a gait where a person names none."""

from pathlib import Path

from glassgait.models.policies.library import load_expert, policy_path, shipped_experts
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.task.gait import Gait
from glassgait.studies.common.console import note

TRAINING_FOLDER = Path("runs/training")


def find_expert(gait: Gait, path: Path | None = None) -> NeuralPolicy:
    """Loads the expert of a gait, and notes which, where that is not the shipped one.

    Args:
        gait: The gait.
        path: The expert's file; by default the shipped one, and where none ships, what
            `glassgait train` keeps in runs/training/<gait>.

    Raises:
        InputError: if there is no expert, or the file holds something else, or the expert of
            another gait.
    """
    if path is None and gait.name not in shipped_experts():
        trained = policy_path(TRAINING_FOLDER / gait.name, gait.name)
        if trained.exists():
            note(f"expert: {trained}, since none of the {gait.name} ships")
            path = trained
    return load_expert(gait, path)
