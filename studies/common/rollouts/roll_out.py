"""Rolling controllers out: many robots in batch, or few in the systems diagram."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from glassgait.diagrams.commands import SliderCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import Rollout, make_simulator, record
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.task_config import NO_SLIDERS
from glassgait.models.errors import InputError
from glassgait.models.policies.controller import AlternatingController, Controller
from glassgait.models.task.alternation import expert_acts
from glassgait.models.task.gait import Gait
from glassgait.models.task.randomization import NOMINAL
from glassgait.studies.common.episode import Event, Observer, episode
from glassgait.studies.common.observers import Log, RolloutLog, forward_and_yaw, joint_power
from glassgait.studies.common.rollouts.config import RolloutConfig


def roll_out(
    gait: Gait,
    controller: Controller,
    scenario: Scenario,
    config: RolloutConfig,
    *,
    observers: Sequence[Observer] = (),
    events: Sequence[Event] = (),
) -> RolloutLog:
    """Rolls out the robots of the first seed, from near the default stance.

    Args:
        gait: The gait.
        controller: The controller.
        scenario: The world.
        config: How.
        observers: What else records the episode; of discrete plants alone.
        events: What happens in it; of discrete plants alone.

    Raises:
        InputError: if the scenario's commands are of sliders or beyond the gait's range, or the
            plant is continuous, and the controller is none that a diagram has systems for.
    """
    scenario = config.commanding(scenario)
    if scenario.accuracy is not None:
        return _roll_out_diagrams(gait, controller, scenario, config)
    log = Log(controller.robot, limited=scenario.limits_targets(controller))
    episode(
        gait,
        controller,
        scenario,
        n_robots=config.robots_in(scenario),
        n_steps=config.n_steps,
        seed=config.seed,
        observers=(log, *observers),
        events=events,
    )
    return log.rollout(config.n_steps)


def _roll_out_diagrams(
    gait: Gait, controller: Controller, scenario: Scenario, config: RolloutConfig
) -> RolloutLog:
    if isinstance(scenario.command, SliderCommand):
        raise InputError(f"{scenario.refused_as()}: {NO_SLIDERS}")
    # One diagram serves all robots; each has a context, and with it a seed, of its own.
    diagram = MakeLocomotion(gait, scenario, policy=controller)
    n = config.robots_in(scenario)
    states = NOMINAL.initial_states(controller.robot, n, np.random.default_rng(config.seed))
    logs = []
    for index, state in enumerate(states):
        simulator = make_simulator(
            diagram, state=state, seed=config.seed * n + index, accuracy=scenario.accuracy
        )
        logs.append(
            _to_log(
                record(simulator, config.n_steps),
                config.n_steps,
                controller,
                limited=scenario.limits_targets(controller),
            )
        )
    return RolloutLog(
        **{
            name: np.stack([getattr(log, name) for log in logs], axis=1)
            for name in RolloutLog.__annotations__
        }
    )


def _to_log(rollout: Rollout, n_steps: int, controller: Controller, *, limited: bool) -> RolloutLog:
    log = RolloutLog(
        velocity=forward_and_yaw(rollout["state"])[1:],
        command=rollout["command"][:-1],
        power=joint_power(
            controller.robot, rollout["state"][1:], rollout["actions"][:-1], limited=limited
        ),
        action=rollout["actions"][:-1],
        expert_acts=_expert_acts(rollout, controller),
        reward=rollout["reward"][1:, 0],
        plain_reward=rollout["plain_reward"][1:, 0],
        served_dwell=rollout["served_dwell"][1:, 0],
        failures=rollout["failures"][1:] > 0.5,
    )
    return log.padded(n_steps)


def _expert_acts(rollout: Rollout, controller: Controller) -> NDArray[np.bool_]:
    """Returns at which steps (T) the expert acted."""
    if isinstance(controller, AlternatingController):
        acts = expert_acts(np.arange(len(rollout.time) - 1), controller.period)
        return np.asarray(acts)
    return rollout["expert_acts"][:-1, 0] > 0.5
