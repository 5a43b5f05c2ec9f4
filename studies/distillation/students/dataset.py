"""Samples of an expert's actions, by episode, and their files."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from sklearn.metrics import r2_score

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.files import load_arrays, refuse_another, save_arrays
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.models.task.gait import Gait
from glassgait.models.task.symmetry import mirrored_states
from glassgait.studies.common.run_folder import CONFIG_NAME, read_inputs
from glassgait.studies.distillation.students.student import TrainingSet

START_STEPS = 5
"""Control steps that an episode's start takes: the robot stands and has hardly acted before."""

HELD_OUT_EVERY = 5
"""Every fifth episode is held out: of four speeds in turn, the paper's, each is held out alike."""


@dataclass(frozen=True)
class Dataset:
    """Visited states with the expert's actions.

    Attributes:
        observations: Observations (m, n).
        actions: The expert's actions there (m, 12).
        episodes: Number of the episode that each sample is from (m,), counted from 1.
        minutes: What collecting them took, the fits of the students that acted included.
    """

    observations: Array
    actions: Array
    episodes: NDArray[np.int64]
    minutes: float = 0.0

    @property
    def held_out(self) -> NDArray[np.bool_]:
        """Whether each sample belongs to a held-out episode (m,)."""
        return self.episodes % HELD_OUT_EVERY == 0

    @property
    def starts(self) -> NDArray[np.bool_]:
        """Whether each sample is of the first `START_STEPS` control steps of its episode (m,)."""
        first = np.flatnonzero(np.diff(self.episodes, prepend=0))
        lengths = np.diff(first, append=len(self.episodes))
        return np.arange(len(self.episodes)) - np.repeat(first, lengths) < START_STEPS

    def subset(self, mask: NDArray[np.bool_]) -> "Dataset":
        """Returns the samples where the mask (m,) is true."""
        return Dataset(self.observations[mask], self.actions[mask], self.episodes[mask])

    def union(self, other: "Dataset") -> "Dataset":
        """Aggregates two datasets."""
        return Dataset(
            np.concatenate([self.observations, other.observations]),
            np.concatenate([self.actions, other.actions]),
            np.concatenate([self.episodes, other.episodes]),
            self.minutes + other.minutes,
        )

    def training_set(self, gait: Gait, expert: Policy) -> TrainingSet:
        """Returns what a student of an expert is fitted to."""
        return TrainingSet(
            gait.name,
            expert.observation_names,
            self.observations,
            self.actions,
            self.starts,
            mirrored_states(gait),
            expert.robot,
        )

    def save(self, path: Path, of: str = "") -> None:
        """Writes the samples, and what they are of, to one file, atomically."""
        arrays = {
            "observations": self.observations,
            "actions": self.actions,
            "episodes": self.episodes,
        }
        save_arrays(path, arrays, {"minutes": self.minutes, "of": of})

    @staticmethod
    def load(path: Path, of: str | None = None) -> "Dataset":
        """Reads what `save` wrote.

        Raises:
            InputError: if the file is damaged, or holds no samples, or not those that are asked
                for.
        """
        arrays, header = load_arrays(path)
        refuse_another(path, header.get("of"), of)
        try:
            data = Dataset(**arrays, minutes=float(header["minutes"]))
            sizes = {len(data.observations), len(data.actions), len(data.episodes)}
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"{path}: holds no samples; delete it, and collect anew") from error
        if len(sizes) > 1 or data.actions.shape[1:] != (quadruped.N_JOINTS,):
            raise InputError(f"{path}: holds no samples; delete it, and collect anew")
        return data


def round_paths(folder: Path) -> list[Path]:
    """Lists the files that hold a student's samples, a round each.

    Raises:
        InputError: if there are none.
    """
    paths = sorted(folder.glob("round_*.safetensors"))
    if not paths:
        students = sorted({path.parent for path in folder.glob("*/round_*.safetensors")})
        such = f", such as {students[0]}" if students else ""
        raise InputError(
            f"{folder}: holds no samples; name the folder of a student in a run of distill{such}"
        )
    return paths


def load_rounds(folder: Path) -> Dataset:
    """Reads all samples that a student is fitted to.

    Args:
        folder: Their folder in a distillation's.

    Raises:
        InputError: if it holds none, or one is damaged, or of other observations than the first.
    """
    paths = round_paths(folder)
    data = Dataset.load(paths[0])
    for path in paths[1:]:
        own = Dataset.load(path)
        if own.observations.shape[1:] != data.observations.shape[1:]:
            raise InputError(
                f"{path}: its samples have other observations than those of {paths[0]}; name a "
                "folder that one run collected"
            )
        data = data.union(own)
    return data


def load_rounds_of(folder: Path, gait: Gait, expert: Policy) -> Dataset:
    """Reads the samples in a folder, which have to be of a gait and an expert.

    Raises:
        InputError: as `load_rounds`, and if the run that collected them says that they are of
            another gait or expert, or they are of other observations.
    """
    record = folder.parent / CONFIG_NAME
    made_of = read_inputs(folder.parent, "distill") if record.exists() else {}
    remedy = "name other samples, or the gait of these with --gait and their run with --source"
    # The gait first: of another one the expert is another too.
    for key, own, title in (
        ("gait", gait.digest(), f"the {gait.name} as it is now"),
        ("expert", expert.digest(), f"this expert of the {gait.name} of the {expert.robot.name}"),
    ):
        if made_of.get(key, own) != own:
            raise InputError(
                f"{folder}: its samples are not of {title} (key 'inputs.{key}' of {record}); "
                f"{remedy}"
            )
    data, n_observations = load_rounds(folder), len(expert.observation_names)
    if data.observations.shape[1:] != (n_observations,):
        raise InputError(
            f"{folder}: its samples are not of the {n_observations} observations of the "
            f"{gait.name}'s expert; {remedy}"
        )
    return data


def r2_scores(policy: Policy, dataset: Dataset) -> Array:
    """Returns the coefficient of determination of each joint (12,)."""
    predicted = policy(dataset.observations)
    return np.asarray(r2_score(dataset.actions, predicted, multioutput="raw_values"))
