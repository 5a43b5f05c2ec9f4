"""Rollouts of controllers: many robots in batch, or single robots in a diagram."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
import pandas as pd
from annotated_types import Ge
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram

from glassgait.diagrams.commands import DrawnCommands, FixedCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import Rollout, make_simulator, push, record
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.visualization import save_replay
from glassgait.models.policies.controller import Controller
from glassgait.models.settings import Count, Range, Seed, Settings, checked
from glassgait.models.task import EPISODE_STEPS
from glassgait.models.task.command import check_command
from glassgait.models.task.gait import Gait
from glassgait.studies.common.episode import Event, Observer, episode
from glassgait.studies.common.experiment import REPORTED_SEEDS
from glassgait.studies.common.jobs import Seeds
from glassgait.studies.common.observers import Log, RolloutLog
from glassgait.studies.common.scores import score_rollouts


@checked
class RolloutConfig(Settings):
    """Settings of rollouts.

    Attributes:
        n_robots: Number of robots per seed, by default as in the paper.
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
        """Returns the scenario with `speed_range`, if it is set."""
        if self.speed_range is None:
            return scenario
        return replace(scenario, command=DrawnCommands(self.speed_range))

    def robots_in(self, scenario: Scenario) -> int:
        """Returns the number of robots in a scenario."""
        return min(self.n_robots, scenario.max_robots or self.n_robots)

    @property
    def seeds(self) -> range:
        return range(self.seed, self.seed + self.n_seeds)


@checked
class CommandOverride(Settings):
    """A command that replaces values of another command.

    Attributes:
        speed: Forward speed (m/s).
        yaw_rate: Yaw rate (rad/s).
        dwell: Control steps to stay in an RM state.
    """

    title: ClassVar[str] = "command"

    speed: float | None = None
    yaw_rate: float | None = None
    dwell: Annotated[int, Ge(1)] | None = None

    def override(self, gait: Gait, command: object = None) -> FixedCommand:
        """Overrides a fixed command, by default 0.5 m/s or the gait's greatest speed."""
        values = {name: value for name, value in asdict(self).items() if value is not None}
        check_command(gait, "--command.", **values)
        if not isinstance(command, FixedCommand):
            command = FixedCommand(min(0.5, gait.max_speed), dwell=int(np.clip(8, *gait.dwell)))
        return replace(command, **values)


def roll_out(
    gait: Gait,
    controller: Controller,
    scenario: Scenario,
    config: RolloutConfig,
    *,
    observers: Sequence[Observer] = (),
    events: Sequence[Event] = (),
) -> RolloutLog:
    """Rolls out the robots of the first seed, which start near the default stance.

    Raises an InputError for slider commands.
    """
    scenario, log = config.commanding(scenario), Log()
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


def score(
    gait: Gait, controller: Controller, scenario: Scenario, config: RolloutConfig
) -> pd.DataFrame:
    """Rolls out the robots of the first seed and returns their scores, one row per robot.

    The rhythm of a gait without transitions is NaN.
    """
    scores = score_rollouts(roll_out(gait, controller, scenario, config))
    return scores if gait.transitions else scores.assign(rhythm=np.nan)


def play(
    gait: Gait,
    policy: Controller,
    scenario: Scenario,
    meshcat: Meshcat,
    replay: Path,
    *,
    n_steps: int,
    seed: int = 0,
    repetitions: int = 1,
) -> Rollout:
    """Rolls out one robot in a scenario with its pushes, and writes a replay.

    A fall ends the rollout before `n_steps`. The replay plays `repetitions` times and then stops.
    The seed determines noise, pushes and drawn commands.
    """
    diagram = MakeLocomotion(gait, scenario, policy=policy, meshcat=meshcat)
    simulator = make_simulator(diagram, seed=seed)
    pushed = pusher(simulator, scenario, seed)
    # `record` calls the pusher, which returns None and therefore never ends the rollout.
    rollout = record(simulator, n_steps, stopped=lambda: bool(pushed()))
    save_replay(diagram, meshcat, rollout, replay, repetitions=repetitions)
    return rollout


def pusher(simulator: Simulator, scenario: Scenario, seed: int) -> Callable[[], None]:
    """Returns a function that pushes the robot at random; call it between control steps."""
    randomization, generator = scenario.randomization(), np.random.default_rng(seed)
    diagram = simulator.get_system()
    assert isinstance(diagram, Diagram)

    def pushed() -> None:
        if scenario.push_speed > 0:
            velocity = randomization.pushes(1, generator)[0]
            push(diagram, simulator.get_mutable_context(), velocity)

    return pushed
