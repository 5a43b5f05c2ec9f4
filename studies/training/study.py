"""The training study: an expert that learns from nothing, with its state estimator."""

import numpy as np

from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.robots.robot import load_robot
from glassgait.models.task.observation import ObservationLayout
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
        layout = ObservationLayout(self.gait.n_states)
        self._mirrored_states = mirrored_states(self.gait) if config.mirrored else None
        reflection = (
            None
            if self._mirrored_states is None
            else reflect_observation(layout.names, self._mirrored_states)
        )
        self.estimator = StateEstimator(layout.n_proprioceptive, config.estimator, reflection)
        environment = TrainingEnvironment(
            config, self.gait, self.estimator, np.random.default_rng(config.seed)
        )
        observations = environment.observe()
        actor = gaussian_actor(config.ppo, observations)
        if reflection is not None:
            act_by(actor, Mirrored(actor.mlp, reflection, REFLECT_JOINTS))
        return environment, Learner(config, observations, actor, self.estimator)

    def write_result(self) -> None:
        """Writes the expert as it is now, its record and its curve."""
        policy = NeuralPolicy(
            self.gait.name,
            self.environment.simulator.layout.names,
            network_of(self.learner.ppo.actor.mlp),
            self.estimator.to_network(),
            self._mirrored_states,
            limits_targets=self.config.limit_targets,
            robot=load_robot(self.config.robot),
        )
        write_learned(policy, self.gait.name, self.config, self.progress, self.folder)
