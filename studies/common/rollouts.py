"""Rolling controllers out: many robots in batch, or few in the systems diagram."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from glassgait.diagrams.commands import DrawnCommands, SliderCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import Rollout, make_simulator, record
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.task_config import NO_SLIDERS
from glassgait.models.errors import InputError
from glassgait.models.policies.controller import AlternatingController, Controller
from glassgait.models.settings import Count, Range, Seed, Settings, checked
from glassgait.models.task import EPISODE_STEPS
from glassgait.models.task.alternation import expert_acts
from glassgait.models.task.gait import Gait
from glassgait.studies.common.episode import Event, Observer, episode
from glassgait.studies.common.observers import Log, RolloutLog, forward_and_yaw, joint_power
from glassgait.studies.common.sweep import Seeds

REPORTED_SEEDS = range(1000, 1005)
"""Seeds of the rollouts that tables report, unless others are named."""

SELECTION_SEEDS = range(500, 510)
"""Seeds of the rollouts that choose among candidates.

A choice among candidates by few robots takes luck for skill, so no table reports these seeds.
"""


@checked
class RolloutConfig(Settings):
    """How robots are rolled out.

    Attributes:
        n_robots: Number of robots for each seed; the paper's 26.
        n_steps: Control steps of a rollout.
        seed: First seed of initial states, commands and noise.
        n_seeds: Number of seeds: seed, seed + 1, …
        speed_range: Least and greatest commanded forward speed (m/s), in place of the scenario's
            commands.
    """

    title: ClassVar[str] = "rollouts"

    n_robots: Count = 26
    n_steps: Count = EPISODE_STEPS
    seed: Seed = REPORTED_SEEDS[0]
    n_seeds: Seeds = 5
    speed_range: Range | None = None

    def commanding(self, scenario: Scenario) -> Scenario:
        """Returns a scenario with the commanded speeds, if they are set."""
        if self.speed_range is None:
            return scenario
        return replace(scenario, command=DrawnCommands(self.speed_range))

    def robots_in(self, scenario: Scenario) -> int:
        """Returns how many robots are rolled out in a scenario."""
        return min(self.n_robots, scenario.max_robots or self.n_robots)

    def refuse_speeds_beyond(self, gait: Gait) -> None:
        """Refuses commanded speeds that the gait is not made for.

        Raises:
            InputError: if a speed is greater than the gait's greatest, forward or backward.
        """
        if any(abs(speed) > gait.max_speed for speed in self.speed_range or ()):
            raise InputError(
                f"rollouts: speed_range is {self.speed_range}; name speeds of the {gait.name} "
                f"from {-gait.max_speed} to {gait.max_speed} m/s"
            )

    @property
    def seeds(self) -> range:
        """Every seed."""
        return range(self.seed, self.seed + self.n_seeds)


def refuse_to_report(seeds: Iterable[int]) -> None:
    """Refuses to report rollouts of seeds that choose.

    Raises:
        InputError: if one of the seeds is kept for selection.
    """
    _refuse(seeds, SELECTION_SEEDS, "rollouts: seed", "choose among candidates")


def refuse_to_select(seeds: Iterable[int], setting: str) -> None:
    """Refuses to choose by rollouts of seeds that are reported.

    Args:
        seeds: The seeds that are to choose.
        setting: The setting that names them, as a sentence begins with it.

    Raises:
        InputError: if one of the seeds is reported.
    """
    _refuse(seeds, REPORTED_SEEDS, setting, "are reported")


def _refuse(seeds: Iterable[int], kept: range, setting: str, what: str) -> None:
    for seed in seeds:
        if seed in kept:
            raise InputError(
                f"{setting} is or leads to {seed}, but {kept[0]} to {kept[-1]} {what}; name others"
            )


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
    log = Log(controller, scenario)
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
    generator, ground = np.random.default_rng(config.seed), scenario.station.ground
    states = scenario.randomization().initial_states(controller.robot, n, generator, ground)
    logs = []
    for index, state in enumerate(states):
        simulator = make_simulator(
            diagram, state=state, seed=config.seed * n + index, accuracy=scenario.accuracy
        )
        rollout = record(simulator, config.n_steps)
        logs.append(_to_log(rollout, config.n_steps, controller, scenario))
    return RolloutLog(
        **{
            name: np.stack([getattr(log, name) for log in logs], axis=1)
            for name in RolloutLog.__annotations__
        }
    )


def _to_log(
    rollout: Rollout, n_steps: int, controller: Controller, scenario: Scenario
) -> RolloutLog:
    log = RolloutLog(
        velocity=forward_and_yaw(rollout["state"])[1:],
        command=rollout["command"][:-1],
        power=joint_power(controller, scenario, rollout["state"][1:], rollout["actions"][:-1]),
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
    assert isinstance(controller, AlternatingController)
    return np.asarray(expert_acts(np.arange(len(rollout.time) - 1), controller.period))
