"""Rolling out policies: many robots in batch, or few in the systems diagram."""

from dataclasses import dataclass

import numpy as np

from diagrams.batch import BatchSimulator, TaskConfig
from diagrams.batch_physics import BatchPhysics
from diagrams.locomotion import DrawnCommands, LocomotionConfig, MakeLocomotion
from diagrams.rollout import Rollout, make_simulator, record
from models.a1 import kinematics
from models.a1.robot import Array
from models.policies.neural import NeuralPolicy
from models.policies.policy import Policy
from models.task.alternation import expert_acts
from models.task.gait import Gait
from models.task.randomization import NOMINAL
from studies.evaluation.config import RolloutConfig, World
from studies.evaluation.scores import RolloutLog


@dataclass(frozen=True)
class Team:
    """Who acts.

    Attributes:
        expert: The expert; its estimator observes for both.
        student: The student, or None.
        period: Control steps from one action of the expert to the next; 1 is the expert alone, 0
            the student alone.
    """

    expert: NeuralPolicy
    student: Policy | None = None
    period: int = 1

    def act(self, step: int, observation: Array) -> Array:
        """Returns the actions (n, 12) at a control step."""
        if self.student is None or expert_acts(step, self.period):
            return self.expert(observation)
        return self.student(observation)


def roll_out(gait: Gait, team: Team, world: World, config: RolloutConfig) -> RolloutLog:
    """Rolls out robots near the default stance, with sensor noise and without pushes."""
    if world.accuracy is None:
        return _roll_out_batch(gait, team, world, config)
    return _roll_out_diagrams(gait, team, world, config)


def _roll_out_batch(gait: Gait, team: Team, world: World, config: RolloutConfig) -> RolloutLog:
    n = min(config.n_robots, world.n_robots)
    task = TaskConfig(gait, NOMINAL, episode_steps=config.n_steps, speed_range=config.speed_range)
    generator = np.random.default_rng(config.seed)
    simulator = BatchSimulator(task, BatchPhysics(world.station), n_robots=n, generator=generator)
    log: dict[str, list[Array]] = {name: [] for name in RolloutLog.__annotations__}
    for step in range(config.n_steps):
        command = simulator.state.command.velocity.copy()
        observation = simulator.observe(team.expert.estimator)
        outcome = simulator.step(team.act(step, observation))
        log["velocity"].append(_forward_and_yaw(simulator.state.plant))
        log["command"].append(command)
        log["reward"].append(outcome.reward)
        log["plain_reward"].append(outcome.plain_reward)
        log["served_dwell"].append(outcome.served_dwell)
        log["failures"].append(outcome.failures)
    return RolloutLog(**{name: np.array(values) for name, values in log.items()})


def _roll_out_diagrams(gait: Gait, team: Team, world: World, config: RolloutConfig) -> RolloutLog:
    generator = np.random.default_rng(config.seed)
    n = min(config.n_robots, world.n_robots)
    states = NOMINAL.initial_states(n, generator)
    logs = [_roll_out_diagram(gait, team, world, config, i, states[i]) for i in range(n)]
    return RolloutLog(
        **{
            name: np.stack([getattr(log, name) for log in logs], axis=1)
            for name in RolloutLog.__annotations__
        }
    )


def _roll_out_diagram(
    gait: Gait, team: Team, world: World, config: RolloutConfig, robot: int, state: Array
) -> RolloutLog:
    locomotion = LocomotionConfig(
        station=world.station,
        command=DrawnCommands(seed=config.seed + robot, speed_range=config.speed_range),
        alternation_period=team.period,
        sensor_noise=True,
    )
    diagram = MakeLocomotion(
        gait,
        locomotion,
        expert=team.expert if team.period != 0 else None,
        student=team.student if team.period != 1 else None,
        estimator=team.expert.estimator,
    )
    simulator = make_simulator(
        diagram, state=state, seed=config.seed + robot, accuracy=world.accuracy
    )
    rollout = record(simulator, config.n_steps)
    log = RolloutLog(
        velocity=_forward_and_yaw(rollout["state"])[1:],
        command=rollout["command"][:-1],
        reward=rollout["reward"][1:, 0],
        plain_reward=rollout["plain_reward"][1:, 0],
        served_dwell=_served_dwell(gait, rollout),
        failures=rollout["failures"][1:] > 0.5,
    )
    return _padded(log, config.n_steps)


def _served_dwell(gait: Gait, rollout: Rollout) -> Array:
    share = np.zeros((gait.n_states, gait.n_states))
    for transition in gait.transitions:
        edge = gait.states.index(transition.source), gait.states.index(transition.target)
        share[edge] = transition.dwell
    state = rollout["rm_state"].argmax(axis=1)
    return share[state[:-1], state[1:]] * rollout["commanded_dwell"][1:, 0]


def _padded(log: RolloutLog, n_steps: int) -> RolloutLog:
    # A rollout that failed ends early; repeating its last step leaves its scores alone.
    missing = n_steps - len(log.reward)
    return RolloutLog(
        **{
            name: np.concatenate([values, np.repeat(values[-1:], missing, axis=0)])
            for name, values in vars(log).items()
        }
    )


def _forward_and_yaw(plant: Array) -> Array:
    linear, angular = kinematics.base_velocity(plant)
    return np.stack([linear[..., 0], angular[..., 2]], axis=-1)
