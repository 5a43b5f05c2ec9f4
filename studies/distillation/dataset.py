"""Samples of an expert's actions, by episode, and their files."""

from dataclasses import dataclass, field, replace
from functools import reduce
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.files import load_arrays, save_arrays
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import Robot
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import machine_state_entries, overdue
from glassgait.models.task.symmetry import mirrored_states

START_STEPS = 5  # number of control steps that count as an episode's start

HELD_OUT_EVERY = 5
"""Every fifth episode is held out, so that the paper's four speeds are held out equally often."""


@dataclass(frozen=True)
class TrainingSet:
    """Observations (m, n), the expert's actions (m, 12), and a mask of episodes' starts (m,).

    `mirror` lists each RM state's mirror image; it is None if the machine favours a side.
    """

    gait: str
    observation_names: tuple[str, ...]
    observations: Array
    actions: Array
    starts: NDArray[np.bool_]
    mirror: tuple[int, ...] | None = None
    robot: Robot = field(default_factory=load_robot)

    def subset(self, index: NDArray[np.int64]) -> "TrainingSet":
        """Returns the samples at indices (k,), which may repeat."""
        return replace(
            self,
            observations=self.observations[index],
            actions=self.actions[index],
            starts=self.starts[index],
        )

    def repeated(self, mask: NDArray[np.bool_], weight: int) -> "TrainingSet":
        """Repeats the samples where the mask (m,) is true `weight` times."""
        return self.subset(np.repeat(np.arange(len(mask)), np.where(mask, weight, 1)))

    def with_overdue(self, weight: int) -> "TrainingSet":
        """Returns the samples, those of robots that wait for a foot repeated `weight` times."""
        return self.repeated(overdue(self.observations, self.observation_names), weight)

    def by_state(self) -> list[NDArray[np.bool_]]:
        """Returns masks (m,) of the samples in each RM state."""
        # A state that was never visited is fitted to all samples.
        masks = self.observations[:, machine_state_entries(self.observation_names)].T > 0.5
        return [mask if mask.any() else np.ones_like(mask) for mask in masks]


@dataclass(frozen=True)
class Dataset:
    """Observations (m, n), the expert's actions (m, 12), and episode numbers (m,), from 1.

    `minutes` is the wall time of the collection, including fits of the students that acted.
    """

    observations: Array
    actions: Array
    episodes: NDArray[np.int64]
    minutes: float = 0.0

    @property
    def held_out(self) -> NDArray[np.bool_]:
        """True for samples of held-out episodes (m,)."""
        return self.episodes % HELD_OUT_EVERY == 0

    @property
    def starts(self) -> NDArray[np.bool_]:
        """True for samples of an episode's first `START_STEPS` control steps (m,)."""
        first = np.flatnonzero(np.diff(self.episodes, prepend=0))
        lengths = np.diff(first, append=len(self.episodes))
        return np.arange(len(self.episodes)) - np.repeat(first, lengths) < START_STEPS

    def subset(self, mask: NDArray[np.bool_]) -> "Dataset":
        """Returns the samples where the mask (m,) is true."""
        return Dataset(self.observations[mask], self.actions[mask], self.episodes[mask])

    def union(self, other: "Dataset") -> "Dataset":
        return Dataset(
            np.concatenate([self.observations, other.observations]),
            np.concatenate([self.actions, other.actions]),
            np.concatenate([self.episodes, other.episodes]),
            self.minutes + other.minutes,
        )

    def training_set(self, gait: Gait, expert: Policy) -> TrainingSet:
        """Returns the samples in the form that students are fitted to."""
        return TrainingSet(
            gait.name,
            expert.observation_names,
            self.observations,
            self.actions,
            self.starts,
            mirrored_states(gait) if expert.symmetric else None,
            expert.robot,
        )

    def save(self, path: Path) -> None:
        """Writes the samples to one file, atomically."""
        arrays = {name: getattr(self, name) for name in ("observations", "actions", "episodes")}
        save_arrays(path, arrays, {"minutes": self.minutes})

    @staticmethod
    def load(path: Path) -> "Dataset":
        arrays, header = load_arrays(path)
        try:
            data = Dataset(**arrays, minutes=float(header["minutes"]))
            sizes = {len(data.observations), len(data.actions), len(data.episodes)}
            if len(sizes) > 1 or data.actions.shape[1:] != (quadruped.N_JOINTS,):
                raise ValueError("arrays of different lengths")
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"{path}: holds no samples; delete it and resume the run") from error
        return data


def load_rounds(folder: Path) -> Dataset:
    """Reads all samples in a student's folder."""
    paths = sorted(folder.glob("round_*.safetensors"))
    if not paths:
        raise InputError(f"{folder}: holds no samples; name a student's folder in a run of distill")
    return reduce(Dataset.union, map(Dataset.load, paths))


def r2_scores(policy: Policy, dataset: Dataset) -> Array:
    """Returns the coefficient of determination of each joint (12,)."""
    from sklearn.metrics import r2_score

    predicted = policy(dataset.observations)
    return np.asarray(r2_score(dataset.actions, predicted, multioutput="raw_values"))
