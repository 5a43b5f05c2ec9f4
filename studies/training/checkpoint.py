"""Checkpoints: everything that a run needs to go on as if it had never stopped."""

from pathlib import Path
from typing import TYPE_CHECKING

from glassgait.models.errors import InputError
from glassgait.models.files import load_arrays, refuse_another, save_arrays

if TYPE_CHECKING:
    from glassgait.studies.training.study import TrainingRun

CHECKPOINT_NAME = "checkpoint.safetensors"


def save_checkpoint(run: "TrainingRun", path: Path) -> None:
    """Writes weights, optimizers, every robot and all generators to one file, atomically."""
    environment_arrays, environment_values = run.environment.to_arrays()
    learner_arrays, learner_values = run.learner.to_arrays()
    arrays = {f"environment:{name}": value for name, value in environment_arrays.items()}
    arrays |= {f"learner:{name}": value for name, value in learner_arrays.items()}
    header = {
        "update": run.progress.update,
        "seconds": run.progress.seconds,
        "curve": run.curve.rows,
        "of": run.identity,
        "environment": environment_values,
        "learner": learner_values,
    }
    save_arrays(path, arrays, header)


def load_checkpoint(run: "TrainingRun", path: Path) -> None:
    """Brings a freshly made run to where the checkpoint's run was.

    Raises:
        InputError: if the checkpoint is missing, damaged, or does not fit the run.
    """
    arrays, header = load_arrays(path)
    refuse_another(path, header.get("of"), run.identity)

    def part(prefix: str) -> dict:
        return {k.removeprefix(prefix): v for k, v in arrays.items() if k.startswith(prefix)}

    try:
        run.environment.restore(part("environment:"), header["environment"])
        run.learner.restore(part("learner:"), header["learner"])
        run.progress.update = header["update"]
        run.progress.seconds = header["seconds"]
        run.curve.rows = header["curve"]
    except (KeyError, TypeError, ValueError, AttributeError, RuntimeError) as error:
        raise InputError(f"{path}: is damaged; train anew into another folder") from error
