"""A run that learns by PPO: collect, learn, log, checkpoint, and in the end the policy."""

import hashlib
import json
import time
from abc import ABC, abstractmethod
from pathlib import Path

import psutil
import torch
from torch.utils.tensorboard import SummaryWriter

from glassgait.models.task.gait import Gait
from glassgait.models.task.reward import REWARD_TERMS
from glassgait.studies.common.run_folder import CHECKPOINT_NAME, to_plain
from glassgait.studies.training.checkpoint import load_checkpoint, save_checkpoint
from glassgait.studies.training.config import TrainingConfig
from glassgait.studies.training.environment import Environment, TrainingStep
from glassgait.studies.training.learner import Learner
from glassgait.studies.training.progress import Progress


class LearningRun(ABC):
    """A run in its folder, from the first update or from its checkpoint."""

    environment: Environment
    learner: Learner

    def __init__(
        self, config: TrainingConfig, gait: Gait, folder: Path, *, resume: bool = False
    ) -> None:
        """
        Args:
            config: Settings; a resumed run must have the same, except for more updates.
            gait: The gait that they name.
            folder: Where checkpoint, curve and TensorBoard events go.
            resume: Whether to continue from the folder's checkpoint.

        Raises:
            InputError: if there is nothing to resume, or it is damaged.
        """
        self.config = config
        self.gait = gait
        self.folder = folder
        self.progress = Progress()
        torch.manual_seed(config.seed)
        self.environment, self.learner = self._begin()
        if resume:
            self.progress = load_checkpoint(
                folder / CHECKPOINT_NAME,
                environment=self.environment,
                learner=self.learner,
                of=self.identity,
            )

    @abstractmethod
    def _begin(self) -> tuple[Environment, Learner]:
        """Makes the robots, and what they learn."""

    @abstractmethod
    def write_result(self) -> None:
        """Writes what was learned so far, with its record."""

    def run(self, report) -> None:
        """Learns to the end, calling `report(run, row)` after every update."""
        if self.progress.update == self.config.updates:
            # A run may have been killed after its last checkpoint and before its result.
            self.write_result()
        writer = SummaryWriter(str(self.folder / "tensorboard"), purge_step=self.progress.update)
        try:
            while self.progress.update < self.config.updates:
                row = self.update()
                for name, value in row.items():
                    writer.add_scalar(name, value, self.progress.update)
                done = self.progress.update
                if done % self.config.checkpoint_updates == 0 or done == self.config.updates:
                    self.save()
                report(self, row)
        finally:
            writer.close()

    def save(self) -> None:
        """Writes a checkpoint, and what was learned so far."""
        save_checkpoint(
            self.folder / CHECKPOINT_NAME,
            environment=self.environment,
            learner=self.learner,
            progress=self.progress,
            of=self.identity,
        )
        self.write_result()

    def update(self) -> dict[str, float]:
        """Collects one batch of steps, learns from it, and returns the row of the curve."""
        started = time.monotonic()
        if self.progress.update and self.progress.update % self.config.friction_updates == 0:
            self.environment.draw_worlds()
        self.learner.hold_actor(self.progress.update < self.config.ppo.critic_updates)
        statistics, ppo = _Statistics(), self.learner.ppo
        with torch.inference_mode():
            for _, step in self.environment.play(ppo.act, self.config.ppo.steps_per_update):
                ppo.process_env_step(
                    step.observations, step.rewards, step.dones, {"time_outs": step.time_outs}
                )
                statistics.add(step)
        losses = self.learner.update(step.observations, self.progress.update)
        self.progress.update += 1
        self.progress.seconds += time.monotonic() - started
        row = {
            "update": float(self.progress.update),
            "control_steps": float(self.control_steps),
            "difficulty": self.environment.difficulty,
            "hardship": self.environment.hardship,
            **statistics.means(),
            **losses,
            "seconds": self.progress.seconds,
            "memory_mb": psutil.Process().memory_info().rss / 2**20,
        }
        self._raise_demands(row["rhythm"], row["failure_rate"])
        self.progress.curve.append(row)
        return row

    @property
    def identity(self) -> str:
        """Returns a digest of what a run learns from, not of how far it has come."""
        settings = {key: value for key, value in to_plain(self.config).items() if key != "updates"}
        made_of = json.dumps([settings, self.gait.digest(), *self._inputs()])
        return hashlib.sha256(made_of.encode()).hexdigest()[:16]

    def _inputs(self) -> tuple[str, ...]:
        """Returns digests of what the run learns from, besides its gait."""
        return ()

    @property
    def control_steps(self) -> int:
        """Control steps of all robots so far."""
        return self.progress.update * self.config.steps_per_update

    def _raise_demands(self, rhythm: float, failure_rate: float) -> None:
        curriculum, environment = self.config.curriculum, self.environment
        if rhythm <= curriculum.required_rhythm:
            return
        if environment.difficulty == 1.0 and failure_rate <= curriculum.most_failures:
            environment.hardship = min(1.0, environment.hardship + curriculum.hardship_rise)
        environment.difficulty = min(1.0, environment.difficulty + curriculum.rise)


class _Statistics:
    """Means over the steps of one update."""

    def __init__(self) -> None:
        self._sums: dict[str, float] = {}
        self._count = 0

    def add(self, step: TrainingStep) -> None:
        task = step.task
        values = {
            "reward": task.reward.mean(),
            "plain_reward": task.plain_reward.mean(),
            "rhythm": task.served_dwell.mean(),
            "failure_rate": task.terminated.mean(),
        }
        values |= {f"terms/{name}": task.terms[:, i].mean() for i, name in enumerate(REWARD_TERMS)}
        for name, value in values.items():
            self._sums[name] = self._sums.get(name, 0.0) + float(value)
        self._count += 1

    def means(self) -> dict[str, float]:
        return {name: value / self._count for name, value in self._sums.items()}
