"""Training runs with PPO: collect, learn, log, checkpoint, and write the policy."""

import platform
import time
from abc import ABC, abstractmethod
from collections import defaultdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
import yaml
from torch.utils.tensorboard import SummaryWriter

from glassgait.models.errors import InputError
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.files import load_arrays, save_arrays, write_atomically
from glassgait.models.policies.library import load_policy
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.robots.library import load_robot
from glassgait.models.settings import Settings
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import REFLECT_JOINTS, ObservationLayout, reflect_observation
from glassgait.models.task.reward import REWARD_TERMS
from glassgait.models.task.symmetry import mirrored_states
from glassgait.studies.common.console import console, progress_bar
from glassgait.studies.common.run import CHECKPOINT_NAME, to_plain
from glassgait.studies.training.config import TrainingConfig
from glassgait.studies.training.environment import Environment
from glassgait.studies.training.learner import (
    Learner,
    LegByLeg,
    Mirrored,
    StateEstimator,
    gaussian_actor,
    leg_masks,
    network_of,
    set_layers,
    set_network,
)
from glassgait.studies.training.record import recipe

LINES_EVERY = 10  # updates between two printed lines without a terminal
RECENT_UPDATES = 20  # number of last updates whose mean is the final value in a record
PACKAGES = ("drake", "torch", "rsl-rl-lib", "numpy")  # software whose versions are in a record


class LearningRun(ABC):
    """A training run in its folder, from the first update or from a checkpoint."""

    environment: Environment
    learner: Learner

    def __init__(
        self, config: TrainingConfig, gait: Gait, folder: Path, *, resume: bool = False
    ) -> None:
        """Begins a run, or continues from the folder's checkpoint."""
        self.config, self.gait, self.folder = config, gait, folder
        self.n_updates = 0
        # Wall time (s), also of earlier parts of an interrupted run, and one row per update.
        self.seconds = 0.0
        self.curve: list[dict[str, float]] = []
        torch.manual_seed(config.seed)
        self.environment, self.learner = self._begin()
        if resume:
            self.restore()

    @abstractmethod
    def _begin(self) -> tuple[Environment, Learner]:
        """Makes the robots and the networks to train."""

    @abstractmethod
    def write_result(self) -> None:
        """Writes the current policy and its record."""

    def run(self) -> None:
        """Trains to the end and reports progress."""
        updates, every = self.config.updates, self.config.checkpoint_updates
        if self.n_updates > updates:
            raise InputError(
                f"{self.folder}: has {self.n_updates} updates already; raise --updates"
            )
        if self.n_updates == updates:
            # A run may have been killed after its last checkpoint, before it wrote its result.
            self.write_result()
        with (
            SummaryWriter(str(self.folder / "tensorboard"), purge_step=self.n_updates) as writer,
            progress_bar(updates, self.n_updates) as (progress, task),
        ):
            while self.n_updates < updates:
                row = self.update()
                for name, value in row.items():
                    writer.add_scalar(name, value, self.n_updates)
                if self.n_updates % every == 0 or self.n_updates == updates:
                    self.save()

                # Report.
                line = (
                    f"{self.n_updates * self.config.steps_per_update / self.seconds:5.0f} steps/s  "
                    f"reward {row['reward']:.3f}  rhythm {row['rhythm']:.2f}  "
                    f"difficulty {row['difficulty']:.2f}  failures {row['failure_rate']:.4f}"
                )
                progress.update(task, completed=self.n_updates, text=line)
                if not console.is_terminal and self.n_updates % LINES_EVERY == 0:
                    console.print(f"update {self.n_updates}/{updates}  {line}")

    def update(self) -> dict[str, float]:
        """Collects steps and trains with them; returns the row of the learning curve."""
        started = time.monotonic()
        if self.n_updates and self.n_updates % self.config.friction_updates == 0:
            self.environment.change_ground(self.n_updates)

        # Collect.
        self.learner.hold_actor(self.n_updates < self.config.ppo.critic_updates)
        ppo, n_steps = self.learner.ppo, self.config.ppo.steps_per_update
        totals: defaultdict[str, float] = defaultdict(float)
        with torch.inference_mode():
            for _, step in self.environment.play(ppo.act, n_steps):
                ppo.process_env_step(
                    step.observations, step.rewards, step.dones, {"time_outs": step.time_outs}
                )
                task = step.task
                means = {
                    "reward": task.reward,
                    "plain_reward": task.plain_reward,
                    "rhythm": task.served_dwell,
                    "failure_rate": task.terminated,
                    **{f"terms/{name}": task.terms[:, i] for i, name in enumerate(REWARD_TERMS)},
                }
                for name, values in means.items():
                    totals[name] += float(values.mean())

        # Learn.
        losses = self.learner.update(step.observations, self.n_updates)
        self.n_updates += 1
        self.seconds += time.monotonic() - started
        row = {
            "update": float(self.n_updates),
            "control_steps": float(self.n_updates * self.config.steps_per_update),
            "difficulty": self.environment.simulator.difficulty,
            "hardship": self.environment.simulator.push_share,
            **{name: total / n_steps for name, total in totals.items()},
            **losses,
            "seconds": self.seconds,
        }
        self._advance_curriculum(row["rhythm"], row["failure_rate"])
        self.curve.append(row)
        return row

    def _advance_curriculum(self, rhythm: float, failure_rate: float) -> None:
        # Hardship grows only at the full difficulty of the reward machine.
        curriculum, simulator = self.config.curriculum, self.environment.simulator
        if rhythm <= curriculum.required_rhythm:
            return
        if simulator.difficulty == 1.0 and failure_rate <= curriculum.most_failures:
            simulator.push_share = min(1.0, simulator.push_share + curriculum.hardship_rise)
        simulator.difficulty = min(1.0, simulator.difficulty + curriculum.rise)

    def save(self) -> None:
        """Writes a checkpoint of networks, optimizers, robots and generators, and the result."""
        arrays: dict[str, Any] = {}
        values: dict[str, Any] = {}
        for name, item in (("environment", self.environment), ("learner", self.learner)):
            item_arrays, values[name] = item.to_arrays()
            arrays |= {f"{name}:{key}": value for key, value in item_arrays.items()}
        values |= {"update": self.n_updates, "seconds": self.seconds, "curve": self.curve}
        save_arrays(self.folder / CHECKPOINT_NAME, arrays, values)
        self.write_result()

    def restore(self) -> None:
        """Continues from the folder's checkpoint; raises an InputError if it is damaged."""
        path = self.folder / CHECKPOINT_NAME
        arrays, header = load_arrays(path)
        try:
            for name, item in (("environment", self.environment), ("learner", self.learner)):
                prefix = f"{name}:"
                item.restore(
                    {k.removeprefix(prefix): v for k, v in arrays.items() if k.startswith(prefix)},
                    header[name],
                )
            self.n_updates, self.seconds = header["update"], header["seconds"]
            self.curve = header["curve"]
        except (KeyError, TypeError, ValueError, AttributeError, RuntimeError) as error:
            raise InputError(f"{path}: is damaged; train again in another folder") from error

    def _write_policy(self, policy: Policy, name: str, study: Settings | None = None) -> None:
        """Writes a policy, its record with a study's further settings, and its learning curve."""
        # Assemble the record of the training and its final values.
        curve = pd.DataFrame(self.curve)
        recent = curve.tail(RECENT_UPDATES).mean()
        steps = self.n_updates * self.config.steps_per_update
        record = {
            "gait": policy.gait,
            "seed": self.config.seed,
            "updates": self.n_updates,
            "control_steps": steps,
            "simulated_hours": round(steps * CONTROL_PERIOD / 3600, 2),
            "wall_minutes": round(self.seconds / 60, 1),
            "control_steps_per_second": round(steps / self.seconds),
            "final": {
                key: round(float(recent[key]), 4)
                for key in ("plain_reward", "reward", "rhythm", "failure_rate", "difficulty")
            },
            "software": {package: version(package) for package in PACKAGES}
            | {"python": platform.python_version()},
            **({} if study is None else {study.title: to_plain(study)}),
            "config": recipe(self.config),
        }

        # Write the files.
        policy.save(self.folder / f"{name}{policy.suffix}")
        write_atomically(self.folder / f"{name}.yaml", yaml.safe_dump(record, sort_keys=False))
        table = curve.to_csv(index=False, float_format="%.6g")
        write_atomically(self.folder / f"{name}.csv", table)


class TrainingRun(LearningRun):
    """A run that trains an expert, and its state estimator if `senses` is "learned"."""

    def _begin(self) -> tuple[Environment, Learner]:
        config = self.config
        # Raises an InputError early if it does not fit the robot.
        self._law = config.expert_law
        imu = config.senses == "imu"
        layout = ObservationLayout(self.gait.n_states, imu=imu)
        mirror = self._mirrored_states = mirrored_states(self.gait) if config.mirrored else None
        start = _load_start(config, layout, mirror)
        reflection = None if mirror is None else reflect_observation(layout.names, mirror)

        # The estimator is trained with the actor, or is odometry.
        learned = None
        if config.senses == "learned":
            learned = StateEstimator(layout.n_proprioceptive, config.estimator, reflection)
        self.estimator = learned or config.odometry
        generator = np.random.default_rng(config.seed)
        environment = Environment(config, self.gait, self.estimator, generator, observes_imu=imu)

        # The actor starts from random weights or from another expert's.
        observations = environment.observe()
        actor = gaussian_actor(config.ppo, observations)
        if start is not None:
            set_layers(actor.mlp, start.actor)
        if config.actor == "local":
            set_network(actor, LegByLeg(actor.mlp, layout.names))
        if reflection is not None:
            set_network(actor, Mirrored(actor.mlp, reflection, REFLECT_JOINTS))
        return environment, Learner(config, observations, actor, learned)

    def write_result(self) -> None:
        """Writes the current expert, its record and its learning curve."""
        policy = NeuralPolicy(
            self.gait.name,
            self.environment.simulator.layout.names,
            network_of(self.learner.ppo.actor.mlp),
            self.estimator if isinstance(self.estimator, Odometry) else self.estimator.to_network(),
            self._mirrored_states,
            robot=load_robot(self.config.robot),
        )
        self._write_policy(policy.with_joint_law(self._law), self.gait.name)


def _load_start(
    config: TrainingConfig, layout: ObservationLayout, mirrored: tuple[int, ...] | None
) -> NeuralPolicy | None:
    """Loads the expert of the warm start, if there is one."""
    if config.warm_start is None:
        return None
    path, robot = Path(config.warm_start), load_robot(config.robot)
    start = load_policy(path, robot)
    if not isinstance(start, NeuralPolicy):
        raise InputError(f"{path}: is of kind {start.kind!r}; give the network of an expert")

    # Its observation, size and symmetry must be those of this run's actor.
    if start.observation_names != layout.names:
        raise InputError(
            f"{path}: its {len(start.observation_names)} observations differ from the "
            f"{len(layout.names)} of this run; start from an expert with the same senses, of a "
            "gait with as many states"
        )
    widths = tuple(len(bias) for bias in start.actor.biases[:-1])
    if widths != config.ppo.actor_layers:
        raise InputError(
            f"{path}: has layers of {widths}; set ppo.actor_layers: {[*widths]} in the settings"
        )
    masks = leg_masks(layout.names, start.actor)
    others = (weight[~mask] for weight, mask in zip(start.actor.weights, masks, strict=True))
    actor = "dense" if any(weights.any() for weights in others) else "local"
    if actor != config.actor:
        raise InputError(f"{path}: has a {actor} actor; train with --actor {actor}")
    if start.mirrored_states != mirrored:
        remedy = "remove --no-mirrored" if mirrored is None else "train with --no-mirrored"
        raise InputError(f"{path}: has another symmetry than this run; {remedy}")
    return start
