"""Rolling out policies: many robots in batch, or few in the systems diagram."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glassgait.diagrams.batch import BatchSimulator
from glassgait.diagrams.commands import SliderCommand
from glassgait.diagrams.engines import make_physics
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import Rollout, make_simulator, record
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.task_config import NO_SLIDERS, TaskConfig
from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.policies.controller import (
    AlternatingController,
    Controller,
    estimator_in_loop,
)
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task.alternation import expert_acts
from glassgait.models.task.gait import Gait
from glassgait.models.task.randomization import NOMINAL
from glassgait.studies.common.rollouts.config import RolloutConfig
from glassgait.studies.common.rollouts.scores import RolloutLog


def roll_out(
    gait: Gait, policy: Controller, scenario: Scenario, config: RolloutConfig
) -> RolloutLog:
    """Rolls out the robots of the first seed, from near the default stance.

    Raises:
        InputError: if the scenario's commands are of sliders or beyond the gait's range, or a
            continuous one meets a policy whose observations are ablated.
    """
    scenario = config.commanding(scenario)
    if scenario.accuracy is None:
        return _roll_out_batch(gait, policy, scenario, config)
    return _roll_out_diagrams(gait, policy, scenario, config)


def _roll_out_batch(
    gait: Gait, policy: Controller, scenario: Scenario, config: RolloutConfig
) -> RolloutLog:
    n = _n_robots(scenario, config)
    simulator = make_batch(gait, policy, scenario, n_robots=n, seed=config.seed)
    return log_policy(simulator, policy, config.n_steps)


def make_batch(
    gait: Gait, policy: Controller, scenario: Scenario, *, n_robots: int, seed: int
) -> BatchSimulator:
    """Makes a simulator of a scenario, closed on the sensors that the policy observes with.

    Raises:
        InputError: if the scenario's commands are of sliders or beyond the gait's range.
    """
    task = TaskConfig.of_scenario(gait, scenario, policy)
    return BatchSimulator(
        task,
        make_physics(task.robot, scenario.station),
        n_robots=n_robots,
        generator=np.random.default_rng(seed),
        estimator=estimator_in_loop(policy, true_body_state=scenario.true_body_state),
    )


def log_policy(simulator: BatchSimulator, policy: Controller, n_steps: int) -> RolloutLog:
    """Lets a policy move robots from where they are, and logs what they do."""
    memory = policy.begin(simulator.n_robots)

    def act(step: int) -> tuple[Array, NDArray[np.bool_]]:
        nonlocal memory
        output = policy.advance(step, simulator.observe(), memory)
        memory = output.memory
        return output.action, output.expert_acts

    return log_batch(simulator, n_steps, act)


def log_batch(
    simulator: BatchSimulator,
    n_steps: int,
    act: Callable[[int], tuple[Array, NDArray[np.bool_]]],
) -> RolloutLog:
    """Advances robots from where they are, and logs what they do.

    Args:
        simulator: The robots.
        n_steps: Control steps.
        act: Returns the actions (n, 12) at a control step, counted from 0, and whether they are the
            expert's (n).
    """
    log: dict[str, list[Any]] = {name: [] for name in RolloutLog.__annotations__}
    failed = np.zeros((simulator.n_robots, 1), dtype=bool)
    for step in range(n_steps):
        given, expert_acts = act(step)
        # A fallen robot counts no more; a policy that fell may well diverge on the ground.
        action = np.where(failed, 0.0, given)
        command = simulator.state.command.velocity
        outcome = simulator.step(action)
        failed |= outcome.failures.any(axis=-1, keepdims=True)
        log["velocity"].append(_forward_and_yaw(simulator.state.plant))
        log["power"].append(
            _power(
                simulator.task.robot,
                simulator.state.plant,
                simulator.state.action,
                limited=simulator.task.limit_targets,
            )
        )
        log["action"].append(action)
        log["expert_acts"].append(expert_acts)
        log["command"].append(command)
        log["reward"].append(outcome.reward)
        log["plain_reward"].append(outcome.plain_reward)
        log["served_dwell"].append(outcome.served_dwell)
        log["failures"].append(outcome.failures)
        if failed.all():
            break
    arrays: dict[str, Any] = {name: np.array(values) for name, values in log.items()}
    whole = RolloutLog(**arrays)
    return _padded(whole, n_steps)


def _n_robots(scenario: Scenario, config: RolloutConfig) -> int:
    return min(config.n_robots, scenario.max_robots or config.n_robots)


def _roll_out_diagrams(
    gait: Gait, policy: Controller, scenario: Scenario, config: RolloutConfig
) -> RolloutLog:
    if isinstance(scenario.command, SliderCommand):
        raise InputError(f"{scenario.refused_as()}: {NO_SLIDERS}")
    # One diagram serves all robots; each has a context, and with it a seed, of its own.
    diagram = MakeLocomotion(gait, scenario, policy=policy)
    n = _n_robots(scenario, config)
    states = NOMINAL.initial_states(policy.robot, n, np.random.default_rng(config.seed))
    logs = []
    for index, state in enumerate(states):
        simulator = make_simulator(
            diagram, state=state, seed=config.seed * n + index, accuracy=scenario.accuracy
        )
        logs.append(
            _to_log(
                record(simulator, config.n_steps),
                config.n_steps,
                policy,
                limited=scenario.limits_targets(policy),
            )
        )
    return RolloutLog(
        **{
            name: np.stack([getattr(log, name) for log in logs], axis=1)
            for name in RolloutLog.__annotations__
        }
    )


def _to_log(rollout: Rollout, n_steps: int, policy: Controller, *, limited: bool) -> RolloutLog:
    log = RolloutLog(
        velocity=_forward_and_yaw(rollout["state"])[1:],
        command=rollout["command"][:-1],
        power=_power(policy.robot, rollout["state"][1:], rollout["actions"][:-1], limited=limited),
        action=rollout["actions"][:-1],
        expert_acts=_expert_acts(rollout, policy),
        reward=rollout["reward"][1:, 0],
        plain_reward=rollout["plain_reward"][1:, 0],
        served_dwell=rollout["served_dwell"][1:, 0],
        failures=rollout["failures"][1:] > 0.5,
    )
    return _padded(log, n_steps)


def _expert_acts(rollout: Rollout, policy: Controller) -> NDArray[np.bool_]:
    """Tells at which steps (T) the expert acted."""
    if isinstance(policy, AlternatingController):
        acts = expert_acts(np.arange(len(rollout.time) - 1), policy.period)
        return np.asarray(acts)
    return rollout["expert_acts"][:-1, 0] > 0.5


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


def _power(robot: Robot, plant: Array, action: Array, *, limited: bool) -> Array:
    velocity = plant[..., quadruped.JOINT_VELOCITY]
    targets = robot.joint_targets(action, limited=limited)
    position = plant[..., quadruped.JOINT_POSITION]
    torque = robot.joint_torque(target=targets, position=position, velocity=velocity)
    return np.abs(torque * velocity).sum(axis=-1)
