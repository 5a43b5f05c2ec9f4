"""The training study: collect, learn, log, checkpoint, and in the end an expert."""

import hashlib
import json
import time
from pathlib import Path

import numpy as np
import psutil
import torch
from torch.utils.tensorboard import SummaryWriter

from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import ObservationLayout
from glassgait.models.task.reward import REWARD_TERMS
from glassgait.models.task.symmetry import mirrored_states, reflect_observation
from glassgait.studies.records import to_plain
from glassgait.studies.training.checkpoint import CHECKPOINT_NAME, load_checkpoint, save_checkpoint
from glassgait.studies.training.config import TrainingConfig
from glassgait.studies.training.environment import TrainingEnvironment
from glassgait.studies.training.estimator import StateEstimator
from glassgait.studies.training.learner import Learner
from glassgait.studies.training.progress import Progress
from glassgait.studies.training.record import write_expert


class TrainingRun:
    """A training run in its folder, from the first update or from its checkpoint."""

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
        self.folder = folder
        self.progress = Progress()
        torch.manual_seed(config.seed)
        self.gait = gait
        layout = ObservationLayout(self.gait.n_states)
        self._mirrored_states = mirrored_states(gait) if config.mirrored else None
        reflection = (
            None
            if self._mirrored_states is None
            else reflect_observation(layout.names, self._mirrored_states)
        )
        self._estimator = StateEstimator(layout.n_proprioceptive, config.estimator, reflection)
        generator = np.random.default_rng(config.seed)
        self.environment = TrainingEnvironment(config, gait, self._estimator, generator)
        self.learner = Learner(config, self._estimator, self.environment.observe(), reflection)
        if resume:
            self.progress = load_checkpoint(
                folder / CHECKPOINT_NAME,
                environment=self.environment,
                learner=self.learner,
                of=self.identity,
            )

    def run(self, report) -> None:
        """Trains to the end, calling `report(run, row)` after every update."""
        if self.progress.update == self.config.updates:
            # A run may have been killed after its last checkpoint and before its expert.
            self._write_expert()
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
        """Writes checkpoint, curve and the expert as it is now."""
        save_checkpoint(
            self.folder / CHECKPOINT_NAME,
            environment=self.environment,
            learner=self.learner,
            progress=self.progress,
            of=self.identity,
        )
        self._write_expert()

    def _write_expert(self) -> None:
        names = self.environment.simulator.layout.names
        policy = self.learner.to_policy(self.gait.name, names, self._mirrored_states)
        write_expert(policy, self.config, self.progress, self.folder)

    def update(self) -> dict[str, float]:
        """Collects one batch of steps, learns from it, and returns the row of the curve."""
        started = time.monotonic()
        simulator = self.environment.simulator
        if self.progress.update and self.progress.update % self.config.friction_updates == 0:
            simulator.resample_friction()
        statistics = _Statistics()
        observations = self.environment.observe()
        with torch.inference_mode():
            for _ in range(self.config.ppo.steps_per_update):
                actions = self.learner.ppo.act(observations)
                step = self.environment.step(actions)
                observations = step.observations
                self.learner.ppo.process_env_step(
                    observations, step.rewards, step.dones, {"time_outs": step.time_outs}
                )
                statistics.add(step.task)
        losses = self.learner.update(observations, self.progress.update)
        self.progress.update += 1
        self.progress.seconds += time.monotonic() - started
        row = {
            "update": float(self.progress.update),
            "control_steps": float(self.control_steps),
            "difficulty": simulator.difficulty,
            **statistics.means(),
            **losses,
            "seconds": self.progress.seconds,
            "memory_mb": psutil.Process().memory_info().rss / 2**20,
        }
        self._raise_difficulty(row["rhythm"])
        self.progress.curve.append(row)
        return row

    @property
    def identity(self) -> str:
        """Tells runs apart that do not learn the same, however far they have come."""
        settings = {key: value for key, value in to_plain(self.config).items() if key != "updates"}
        made_of = json.dumps([settings, self.gait.digest()])
        return hashlib.sha256(made_of.encode()).hexdigest()[:16]

    @property
    def control_steps(self) -> int:
        """Control steps of all robots so far."""
        return self.progress.update * self.config.steps_per_update

    def _raise_difficulty(self, rhythm: float) -> None:
        curriculum, simulator = self.config.curriculum, self.environment.simulator
        if rhythm > curriculum.required_rhythm:
            simulator.difficulty = min(1.0, simulator.difficulty + curriculum.rise)


class _Statistics:
    """Means over the steps of one update."""

    def __init__(self) -> None:
        self._sums: dict[str, float] = {}
        self._count = 0

    def add(self, step) -> None:
        values = {
            "reward": step.reward.mean(),
            "plain_reward": step.plain_reward.mean(),
            "rhythm": step.served_dwell.mean(),
            "failure_rate": step.terminated.mean(),
        }
        values |= {f"terms/{name}": step.terms[:, i].mean() for i, name in enumerate(REWARD_TERMS)}
        for name, value in values.items():
            self._sums[name] = self._sums.get(name, 0.0) + float(value)
        self._count += 1

    def means(self) -> dict[str, float]:
        return {name: value / self._count for name, value in self._sums.items()}
