"""Collecting what the expert would do in the states that expert and student visit together."""

import numpy as np

from glassgait.diagrams.batch import BatchSimulator
from glassgait.diagrams.engines import make_physics
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.task_config import TaskConfig
from glassgait.diagrams.worlds import Worlds
from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.policies.controller import AlternatingController, estimator_in_loop
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy, first_not_finite
from glassgait.models.robots import quadruped
from glassgait.models.task import COMMAND_STEPS
from glassgait.models.task.alternation import expert_acts
from glassgait.models.task.command import Command, sample_commands
from glassgait.models.task.gait import Gait
from glassgait.studies.distillation.rounds import Round
from glassgait.studies.distillation.students.dataset import Dataset


def collect(
    gait: Gait,
    expert: NeuralPolicy,
    student: Policy,
    *,
    plan: Round,
    speeds: Array,
    worlds: Worlds | Scenario,
    generator: np.random.Generator,
) -> Dataset:
    """Rolls out the episodes of one round at once (paper, Algorithm 1, lines 8 to 18).

    The forward speed is an episode's own; yaw rate and rhythm are drawn over the gait's range and
    change every 10 s. A robot that falls starts again, its episode going on.

    Args:
        gait: The gait.
        expert: The expert; its estimator observes for both.
        student: The student.
        plan: The round.
        speeds: Forward speeds that episodes cycle through (m/s), the first episode with the first.
        worlds: The worlds, of which every round draws some anew; or one, but for its commands.
        generator: Source of randomness.

    Raises:
        InputError: if a sample is not finite.
    """
    n = len(plan.episodes)
    policy = AlternatingController(expert, student, plan.period)
    if isinstance(worlds, Scenario):
        task = TaskConfig.of_scenario(gait, worlds, policy, episode_steps=plan.steps)
        stations, blind = [worlds.station], not worlds.true_body_state
    else:
        task = TaskConfig(
            gait,
            worlds.randomization,
            episode_steps=plan.steps,
            limit_targets=policy.limits_targets,
            robot=expert.robot,
        )
        drawn, blind = worlds.stations(expert.robot, generator), True
        stations = [drawn[i] for i in generator.permutation(len(drawn))[:n]]
    episodes = np.array(plan.episodes)
    own_speeds = speeds[(episodes - 1) % len(speeds)]
    simulator = BatchSimulator(
        task,
        make_physics(task.robot, *stations),
        n_robots=n,
        generator=generator,
        estimator=estimator_in_loop(policy, true_body_state=not blind),
    )
    observations, labels = [], []
    for step in range(plan.steps):
        if step % COMMAND_STEPS == 0:
            turns = sample_commands(gait, n, generator)
        simulator.set_command(
            Command(np.stack([own_speeds, turns.velocity[:, 1]], axis=1), turns.dwell)
        )
        observation = simulator.observe()
        label = expert(observation)
        _refuse_not_finite(expert, step, observation, label)
        action = label if expert_acts(step, plan.period) else student(observation)
        observations.append(observation)
        labels.append(label)
        outcome = simulator.step(action)
        simulator.reset(np.flatnonzero(outcome.terminated))
    return Dataset(
        np.swapaxes(observations, 0, 1).reshape(n * plan.steps, -1),
        np.swapaxes(labels, 0, 1).reshape(n * plan.steps, -1),
        np.repeat(episodes, plan.steps),
    )


def _refuse_not_finite(expert: NeuralPolicy, step: int, observation: Array, label: Array) -> None:
    found = first_not_finite(np.concatenate([observation, label], axis=1))
    if found is not None:
        actions = (f"the action of {joint}" for joint in quadruped.JOINTS)
        name = (*expert.observation_names, *actions)[found[1]]
        raise InputError(
            f"expert: {name} is not finite at control step {step} of its episode; train it again, "
            "or give another with --expert"
        )
