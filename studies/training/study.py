"""The training study: an expert that learns from nothing, with its state estimator."""

import numpy as np

from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.robots.robot import load_robot
from glassgait.models.task.observation import ObservationLayout
from glassgait.models.task.odometry import Odometry
from glassgait.models.task.symmetry import REFLECT_JOINTS, mirrored_states, reflect_observation
from glassgait.studies.training.environment import TrainingEnvironment
from glassgait.studies.training.estimator import StateEstimator, network_of
from glassgait.studies.training.learner import Learner, act_by, gaussian_actor
from glassgait.studies.training.learning_run import LearningRun
from glassgait.studies.training.mirror import Mirrored
from glassgait.studies.training.record import write_learned


class TrainingRun(LearningRun):
    """A training run in its folder."""

    def _begin(self) -> tuple[TrainingEnvironment, Learner]:
        config = self.config
        # Refuses a robot that it does not fit before anything is learned.
        self._law = config.expert_law
        imu = config.senses == "imu"
        layout = ObservationLayout(self.gait.n_states, imu=imu)
        self._mirrored_states = mirrored_states(self.gait) if config.mirrored else None
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
        if reflection is not None:
            act_by(actor, Mirrored(actor.mlp, reflection, REFLECT_JOINTS))
        return environment, Learner(config, observations, actor, learned)

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
