"""Episodes: the only loop over control steps in which controllers move robots in batch.

Reinforcement learning loops in `glassgait.studies.training`, where actions are drawn, and Drake
advances the diagram of a single robot (`glassgait.diagrams.rollout.record`).
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Literal, NamedTuple

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


Event = Callable[[int, BatchSimulator], None]
"""Called before each control step, with its number, and may change the simulator."""


def push(at: int, velocity: Array) -> Event:
    """Returns an event that adds a velocity (3,; m/s, world frame) to the trunks before a step."""

    def event(step: int, simulator: BatchSimulator) -> None:
        if step == at:
            simulator.restore(simulator.state.pushed(velocity))

    return event


def give(at: int, command: FixedCommand) -> Event:
    """Returns an event that gives all robots a command from a step on."""

    def event(step: int, simulator: BatchSimulator) -> None:
        if step == at:
            simulator.set_command(command.of_robots(simulator.n_robots))

    return event


class Ended(NamedTuple):
    """End of an episode of n robots.

    Attributes:
        fell: Control step in which each first fell (n,); the number of steps if it did not fall.
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
    simulator, robots = make(n_robots=n_robots), np.arange(n_robots)
    if start is not None:
        simulator.restore(start)
    fell = np.full(n_robots, n_steps)
    for step in range(n_steps):
        # Leave out fallen robots from time to time.
        fallen = fell[robots] < n_steps
        if leave_out_every and step % leave_out_every == 0 and fallen.any():
            up, state = np.flatnonzero(~fallen), simulator.state
            simulator, robots, fallen = make(n_robots=len(up)), robots[up], fallen[up]
            simulator.restore(state.of_robots(up))
        if len(robots) == 0:
            break

        # Apply the events, and act.
        for event in events:
            event(step, simulator)
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
    return Ended(fell, simulator.state)


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
