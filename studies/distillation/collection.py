"""Collecting what the expert would do in the states that expert and student visit together."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glassgait.diagrams.batch import BatchSimulator
from glassgait.diagrams.batch_physics import BatchPhysics
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.task_config import TaskConfig
from glassgait.models.a1 import robot
from glassgait.models.a1.robot import Array
from glassgait.models.errors import InputError
from glassgait.models.files import load_arrays, refuse_another, save_arrays
from glassgait.models.policies.alternating import AlternatingPolicy
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy, first_not_finite
from glassgait.models.task import COMMAND_STEPS
from glassgait.models.task.command import Command, sample_commands
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import machine_state_entries

START_STEPS = 5
"""Control steps that an episode's start takes: the robot stands and has hardly acted before."""

HELD_OUT_EVERY = 5
"""Every fifth episode is held out: with four speeds in turn, each speed is held out alike."""


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
        if len(sizes) > 1 or data.actions.shape[1:] != (robot.N_JOINTS,):
            raise InputError(f"{path}: holds no samples; delete it, and collect anew")
        return data


def collect(
    gait: Gait,
    expert: NeuralPolicy,
    student: Policy,
    *,
    period: int,
    episodes: NDArray[np.int64],
    speeds: Array,
    n_steps: int,
    scenario: Scenario,
    generator: np.random.Generator,
) -> Dataset:
    """Rolls out the episodes of one level at once (paper, Algorithm 1, lines 8 to 18).

    The forward speed is an episode's own; yaw rate and rhythm are drawn over the gait's range and
    change every 10 s. A robot that falls starts again, its episode going on.

    Args:
        gait: The gait.
        expert: The expert; its estimator observes for both.
        student: The student.
        period: Control steps from one action of the expert to the next.
        episodes: Numbers of the episodes (k,).
        speeds: Their forward speeds (k,; m/s).
        n_steps: Control steps of an episode.
        scenario: The world, but for its commands.
        generator: Source of randomness.

    Raises:
        InputError: if a sample is not finite.
    """
    task = TaskConfig.of_scenario(gait, scenario, episode_steps=n_steps)
    policy = AlternatingPolicy(expert, student, period)
    estimator = None if scenario.true_body_state else policy.estimator
    n = len(episodes)
    simulator = BatchSimulator(
        task, BatchPhysics(scenario.station), n_robots=n, generator=generator
    )
    observations, labels = [], []
    for step in range(n_steps):
        if step % COMMAND_STEPS == 0:
            turns = sample_commands(gait, n, generator)
        simulator.set_command(
            Command(np.stack([speeds, turns.velocity[:, 1]], axis=1), turns.dwell)
        )
        observation = simulator.observe(estimator)
        label = expert(observation)
        _refuse_not_finite(expert, step, observation, label)
        action = label if policy.expert_acts(step) else student(observation)
        observations.append(observation)
        labels.append(label)
        outcome = simulator.step(action)
        simulator.reset(np.flatnonzero(outcome.terminated))
    return Dataset(
        np.swapaxes(observations, 0, 1).reshape(n * n_steps, -1),
        np.swapaxes(labels, 0, 1).reshape(n * n_steps, -1),
        np.repeat(episodes, n_steps),
    )


def _refuse_not_finite(expert: NeuralPolicy, step: int, observation: Array, label: Array) -> None:
    found = first_not_finite(np.concatenate([observation, label], axis=1))
    if found is not None:
        actions = (f"the action of {joint}" for joint in robot.JOINTS)
        name = (*expert.observation_names, *actions)[found[1]]
        raise InputError(
            f"expert: {name} is not finite at control step {step} of its episode; train it again, "
            "or give another with --expert"
        )


def level_paths(folder: Path) -> list[Path]:
    """Lists the files that hold a student's samples, a level each.

    Raises:
        InputError: if there are none.
    """
    paths = sorted(folder.glob("level_*.safetensors"))
    if not paths:
        raise InputError(
            f"{folder}: holds no samples; collect them with 'glassgait distill --students "
            f"{folder.name}'"
        )
    return paths


def load_levels(folder: Path) -> Dataset:
    """Reads all samples that a student is fitted to.

    Args:
        folder: Their folder in a distillation's.

    Raises:
        InputError: if it holds none, or one is damaged.
    """
    paths = level_paths(folder)
    data = Dataset.load(paths[0])
    for path in paths[1:]:
        data = data.union(Dataset.load(path))
    return data


def samples_by_state(observations: Array, names: tuple[str, ...]) -> list[NDArray[np.bool_]]:
    """Returns the samples (m,) in each state of the machine.

    A state that was never visited gets all samples, so that it is fitted like all states together.
    """
    visited = observations[:, machine_state_entries(names)].T > 0.5
    return [mine if mine.any() else np.ones_like(mine) for mine in visited]
