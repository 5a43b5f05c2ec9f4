"""The training study: an expert that learns from nothing, with its state estimator."""

from pathlib import Path

import numpy as np

from glassgait.models.errors import InputError
from glassgait.models.policies.library import load_policy
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import read_policy_file
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import DEFAULT_ROBOT
from glassgait.models.task.observation import ObservationLayout
from glassgait.models.task.odometry import Odometry
from glassgait.models.task.symmetry import REFLECT_JOINTS, mirrored_states, reflect_observation
from glassgait.studies.training.config import TrainingConfig
from glassgait.studies.training.environment import TrainingEnvironment
from glassgait.studies.training.estimator import StateEstimator, network_of, set_layers
from glassgait.studies.training.learner import Learner, act_by, gaussian_actor
from glassgait.studies.training.learning_run import LearningRun
from glassgait.studies.training.mirror import Mirrored
from glassgait.studies.training.record import write_learned


class TrainingRun(LearningRun):
    """A training run in its folder."""

    environment: TrainingEnvironment

    def _begin(self) -> tuple[TrainingEnvironment, Learner]:
        config = self.config
        # Refuses a robot that it does not fit before anything is learned.
        self._law = config.expert_law
        imu = config.senses == "imu"
        layout = ObservationLayout(self.gait.n_states, imu=imu)
        self._mirrored_states = mirrored_states(self.gait) if config.mirrored else None
        self._start = _load_start(config, layout, self._mirrored_states)
        reflection = (
            None
            if self._mirrored_states is None
            else reflect_observation(layout.names, self._mirrored_states)
        )
        learned = None
        if config.senses == "learned":
            learned = StateEstimator(layout.n_proprioceptive, config.estimator, reflection)
        self.estimator = learned or config.odometry
        generator = np.random.default_rng(config.seed)
        environment = TrainingEnvironment(
            config, self.gait, self.estimator, generator, observes_imu=imu
        )
        observations = environment.observe()
        actor = gaussian_actor(config.ppo, observations)
        if self._start is not None:
            set_layers(actor.mlp, self._start.actor.plain)
        if reflection is not None:
            act_by(actor, Mirrored(actor.mlp, reflection, REFLECT_JOINTS))
        return environment, Learner(config, observations, actor, learned)

    def _inputs(self) -> tuple[str, ...]:
        return () if self._start is None else (self._start.digest(),)

    def write_result(self) -> None:
        """Writes the expert as it is now, its record and its curve."""
        policy = NeuralPolicy(
            self.gait.name,
            self.environment.simulator.layout.names,
            network_of(self.learner.ppo.actor.mlp),
            self.estimator if isinstance(self.estimator, Odometry) else self.estimator.to_network(),
            self._mirrored_states,
            robot=load_robot(self.config.robot),
        ).with_joint_law(self._law)
        write_learned(policy, self.gait.name, self.config, self.progress, self.folder)


def _load_start(
    config: TrainingConfig, layout: ObservationLayout, mirrored: tuple[int, ...] | None
) -> NeuralPolicy | None:
    """Loads the expert that the actor begins as, if there is one."""
    if config.warm_start is None:
        return None
    path, robot = Path(config.warm_start), load_robot(config.robot)
    # It may be of this robot, which need not ship, or of one that does.
    own = read_policy_file(path)[1].get("robot", DEFAULT_ROBOT) == robot.name
    start = load_policy(path, robot if own else None)
    if not isinstance(start, NeuralPolicy):
        raise InputError(f"{path}: is {start.kind!r}; a run starts from the network of an expert")
    if start.observation_names != layout.names:
        raise InputError(
            f"{path}: observes {len(start.observation_names)} entries, others than the "
            f"{len(layout.names)} of this run; start from an expert with the same senses, of a "
            "gait with as many states"
        )
    widths = start.actor.plain.hidden_layers
    if widths != config.ppo.actor_layers:
        raise InputError(
            f"{path}: has layers of {widths}; train with --ppo.actor-layers "
            f"{' '.join(map(str, widths))}"
        )
    if start.mirrored_states != mirrored:
        remedy = "leave --no-mirrored out" if mirrored is None else "train with --no-mirrored"
        raise InputError(f"{path}: would act otherwise than it learned to; {remedy}")
    return start.for_robot(robot)
