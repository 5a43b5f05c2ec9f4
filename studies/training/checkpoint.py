"""Checkpoints: everything that a run needs to go on as if it had never stopped."""

from pathlib import Path

from glassgait.models.errors import InputError
from glassgait.models.files import load_arrays, refuse_another, save_arrays
from glassgait.studies.training.environment import Environment
from glassgait.studies.training.learner import Learner
from glassgait.studies.training.progress import Progress


def save_checkpoint(
    path: Path,
    *,
    environment: Environment,
    learner: Learner,
    progress: Progress,
    of: str,
) -> None:
    """Writes weights, optimizers, every robot and all generators to one file, atomically.

    Args:
        path: The file.
        environment: The robots.
        learner: What they learn.
        progress: How far the run has come.
        of: What identifies the run.
    """
    environment_arrays, environment_values = environment.to_arrays()
    learner_arrays, learner_values = learner.to_arrays()
    arrays = {f"environment:{name}": value for name, value in environment_arrays.items()}
    arrays |= {f"learner:{name}": value for name, value in learner_arrays.items()}
    header = {
        "update": progress.update,
        "seconds": progress.seconds,
        "curve": progress.curve,
        "of": of,
        "environment": environment_values,
        "learner": learner_values,
    }
    save_arrays(path, arrays, header)


def load_checkpoint(path: Path, *, environment: Environment, learner: Learner, of: str) -> Progress:
    """Brings freshly made parts to where the checkpoint's were.

    Args:
        path: The file.
        environment: The robots, to be changed.
        learner: What they learn, to be changed.
        of: What identifies the run.

    Returns:
        How far the run had come.

    Raises:
        InputError: if the checkpoint is missing, damaged, or does not fit the run.
    """
    arrays, header = load_arrays(path)
    refuse_another(path, header.get("of"), of)

    def part(prefix: str) -> dict:
        return {k.removeprefix(prefix): v for k, v in arrays.items() if k.startswith(prefix)}

    try:
        environment.restore(part("environment:"), header["environment"])
        learner.restore(part("learner:"), header["learner"])
        return Progress(header["update"], header["seconds"], header["curve"])
    except (KeyError, TypeError, ValueError, AttributeError, RuntimeError) as error:
        raise InputError(f"{path}: is damaged; train anew into another folder") from error
