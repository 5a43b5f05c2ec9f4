"""Episodes: the only loop over control steps in which controllers move robots in batch.

Reinforcement learning loops in `glassgait.studies.training`, where actions are drawn, and Drake
advances the diagram of a single robot (`glassgait.diagrams.rollout.record`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glassgait.diagrams.batch import BatchSimulator, BatchStep
from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.physics import Physics, make_physics
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.task import TaskConfig, TaskState
from glassgait.models.arrays import Array
from glassgait.models.policies.controller import (
    Controller,
    ControllerOutput,
    controller_of,
    estimator_in_loop,
)
from glassgait.models.task.command import Command
from glassgait.models.task.gait import Gait

BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]


class World(NamedTuple):
    """A task with its physics, made once for many episodes, or of stations that training draws."""

    task: TaskConfig
    physics: Physics
    true_body_state: bool = False

    @classmethod
    def of(cls, gait: Gait, scenario: Scenario, controller: Controller) -> "World":
        """Makes the world of a scenario; commands that the gait is not made for are refused."""
        task = TaskConfig.of_scenario(gait, scenario, controller)
        physics = make_physics(task.robot, scenario.station_of(controller))
        return cls(task, physics, scenario.true_body_state)


class ControlStep(NamedTuple):
    """A completed control step of n robots.

    Attributes:
        robots: Numbers of the robots (n,), without those that were left out.
        observation: Observations (n, n_obs).
        action: Requested actions (n, 12), 0 of fallen robots; `after.memory.action` is limited.
        fallen: Which robots had fallen by the end of the step (n,).
    """

    step: int
    robots: IntArray
    before: TaskState
    observation: Array
    output: ControllerOutput
    action: Array
    outcome: BatchStep
    after: TaskState
    fallen: BoolArray


class Observer:
    """Records an episode, which ends as soon as an observer is `done`."""

    done: bool = False

    def observe(self, step: ControlStep) -> None:
        """Records a control step."""
        raise NotImplementedError


@dataclass
class Episode:
    """A running episode, as events find it between two control steps.

    Attributes:
        robots: Numbers of its robots (n,), without those that were left out.
        step: Number of the next control step.
    """

    simulator: BatchSimulator
    robots: IntArray
    step: int


class Event(NamedTuple):
    """Changes an episode between two control steps, before robots are observed.

    Attributes:
        step: Control step that it comes before, or each robot's own (n,); None for every step.
        mask: Robots that it comes to (n,); None for all.
    """

    step: int | IntArray | None
    mask: BoolArray | None
    apply: Callable[[Episode, BoolArray], None]

    def happen(self, episode: Episode) -> None:
        """Applies it if it is due."""
        everyone = np.ones(len(episode.robots), dtype=bool)
        due = everyone if self.mask is None else self.mask[episode.robots]
        if self.step is not None:
            due = due & (_of_robots(self.step, 1, episode) == episode.step)
        if due.any():
            self.apply(episode, due)


def push(step: int | IntArray, velocity: Array, mask: BoolArray | None = None) -> Event:
    """Returns a push, which adds a velocity (3,) or (n, 3) to the trunks' (m/s, world frame)."""

    def apply(episode: Episode, robots: BoolArray) -> None:
        added = np.where(robots[:, None], _of_robots(velocity, 2, episode), 0.0)
        episode.simulator.restore(episode.simulator.state.pushed(added))

    return Event(step, mask, apply)


def give(step: int | None, command: Command | FixedCommand) -> Event:
    """Returns a command, one for all robots or (n, 2), (n,) of them, which holds from then on."""

    def apply(episode: Episode, _: BoolArray) -> None:
        if isinstance(command, FixedCommand):
            given = command.of_robots(len(episode.robots))
        else:
            given = Command(*(own[episode.robots] for own in command))
        episode.simulator.set_command(given)

    return Event(step, None, apply)


class Ended(NamedTuple):
    """End of an episode of n robots.

    Attributes:
        fell: Control step in which each fell first (n,); the number of steps where it did not.
        state: The last state, without robots that were left out.
    """

    fell: IntArray
    state: TaskState


def episode(
    gait: Gait,
    controller: Controller | Callable[[Array], Array],
    scenario: Scenario | World,
    *,
    n_robots: int,
    n_steps: int,
    seed: int | np.random.Generator,
    observers: Sequence[Observer] = (),
    events: Sequence[Event] = (),
    start: TaskState | None = None,
    when_fallen: Literal["rest", "restart", "go on"] = "rest",
    leave_out_every: int | None = None,
) -> Ended:
    """Lets a controller move robots; a control step is: events, observe, act, step, record.

    Equal seeds give equal starts, commands and noise, whatever the controller does.

    Args:
        controller: A controller, a policy, or a function from observations (n, n_obs) to actions.
        start: A state to go on from; near the default stance by default.
        when_fallen: Whether a robot that fell is to `rest` with actions of 0, since a policy may
            diverge on the ground, `restart` its episode, or `go on` as if nothing had happened.
        leave_out_every: Control steps after which fallen robots are left out, so that they cost
            nothing more; by default none is. Others draw other noise from then on.

    Raises:
        InputError: if commands come from sliders or the gait is not made for them, or if the
            controller needs an estimator and has none.
    """
    robot = scenario.task.robot if isinstance(scenario, World) else scenario.robot_of()
    controller = controller_of(controller, gait, robot)
    make = _simulator_maker(gait, controller, scenario, np.random.default_rng(seed))
    running = Episode(make(n_robots=n_robots), np.arange(n_robots), 0)
    if start is not None:
        running.simulator.restore(start)
    fell = np.full(n_robots, n_steps)
    for step in range(n_steps):
        # Leave out fallen robots from time to time.
        fallen = fell[running.robots] < n_steps
        if leave_out_every and step % leave_out_every == 0 and fallen.any():
            up = np.flatnonzero(~fallen)
            fewer = make(n_robots=len(up))
            fewer.restore(running.simulator.state.of_robots(up))
            running = Episode(fewer, running.robots[up], step)
            fallen = fallen[up]
        robots, simulator = running.robots, running.simulator
        if len(robots) == 0:
            break

        # Apply the events, and act.
        running.step = step
        for event in events:
            event.happen(running)
        before, observation = simulator.state, simulator.observe()
        output = controller.advance(step, observation)
        action = output.action
        if when_fallen == "rest":
            action = np.where(fallen[:, None], 0.0, action)

        # Step the simulation, and let observers record.
        outcome = simulator.step(action)
        fell[robots[outcome.terminated & ~fallen]] = step
        fallen = fallen | outcome.terminated
        after = simulator.state
        seen = ControlStep(
            step, robots, before, observation, output, action, outcome, after, fallen
        )
        for observer in observers:
            observer.observe(seen)
        if any(observer.done for observer in observers):
            break
        if when_fallen == "restart" and outcome.terminated.any():
            simulator.reset(np.flatnonzero(outcome.terminated))
    return Ended(fell, running.simulator.state)


def _simulator_maker(
    gait: Gait,
    controller: Controller,
    scenario: Scenario | World,
    generator: np.random.Generator,
) -> Callable[..., BatchSimulator]:
    """Returns a function that makes a simulator of `n_robots` for the controller."""
    estimator = estimator_in_loop(controller, true_body_state=scenario.true_body_state)
    if isinstance(scenario, Scenario):
        scenario = World.of(gait, scenario, controller)
    task, physics, _ = scenario
    return partial(BatchSimulator, task, physics, generator=generator, estimator=estimator)


def _of_robots(values: Any, ndim: int, running: Episode) -> Any:
    """Returns the values of an episode's robots, where there is one for each."""
    return np.asarray(values)[running.robots] if np.ndim(values) == ndim else values
