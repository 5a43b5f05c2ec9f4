"""Episodes of many robots in the batch simulator, controlled by a controller.

Training has another loop in `glassgait.studies.training`. `glassgait.diagrams.rollout.record` runs
the diagram of one robot.
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


class PreparedTask(NamedTuple):
    """A task with its physics, for many episodes or for stations with domain randomization."""

    task: TaskConfig
    physics: Physics
    true_body_state: bool = False

    @classmethod
    def of(cls, gait: Gait, scenario: Scenario, controller: Controller) -> "PreparedTask":
        """Prepares a scenario; raises an InputError for commands beyond the gait's range."""
        task = TaskConfig.of_scenario(gait, scenario, controller)
        physics = make_physics(task.robot, scenario.station_of(controller))
        return cls(task, physics, scenario.true_body_state)


class ControlStep(NamedTuple):
    """A completed control step of n robots.

    Attributes:
        robots: Indices of the robots (n,), without removed ones.
        observation: Observations (n, n_obs).
        action: Actions (n, 12), 0 for fallen robots; `after.memory.action` has the limited ones.
        fallen: Whether each robot has fallen by the end of the step (n,).
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
    """Records an episode; the episode ends when an observer is `done`."""

    done: bool = False

    def observe(self, step: ControlStep) -> None:
        """Records a control step."""
        raise NotImplementedError


Event = Callable[[int, BatchSimulator], None]
"""Function called before each control step with the step's number; may change the simulator."""


def push(at: int, velocity: Array) -> Event:
    """Returns an event that adds a velocity (3,; m/s, world frame) to the trunks at a step."""

    def event(step: int, simulator: BatchSimulator) -> None:
        if step == at:
            simulator.restore(simulator.state.pushed(velocity))

    return event


def give(at: int, command: FixedCommand) -> Event:
    """Returns an event that commands all robots from a step on."""

    def event(step: int, simulator: BatchSimulator) -> None:
        if step == at:
            simulator.set_command(command.of_robots(simulator.n_robots))

    return event


class EpisodeEnd(NamedTuple):
    """End of an episode of n robots.

    Attributes:
        fell: Control step of each robot's first fall (n,); the number of steps without a fall.
        state: The last state, without removed robots.
    """

    fell: IntArray
    state: TaskState


def episode(
    gait: Gait,
    controller: Controller | Callable[[Array], Array],
    scenario: Scenario | PreparedTask,
    *,
    n_robots: int,
    n_steps: int,
    seed: int | np.random.Generator,
    observers: Sequence[Observer] = (),
    events: Sequence[Event] = (),
    start: TaskState | None = None,
    memory: Array | None = None,
    when_fallen: Literal["rest", "restart", "go on"] = "rest",
    leave_out_every: int | None = None,
) -> EpisodeEnd:
    """Simulates an episode; each control step applies events, observes, acts, steps and records.

    A seed determines starts, commands and noise for every controller.

    Args:
        controller: A controller, a policy, or a function from observations (n, n_obs) to actions.
        start: Initial state; by default drawn near the default stance.
        memory: The controller's memory at the start (n, n_memory); by default as it begins.
        when_fallen: What a fallen robot does: `rest` with actions of 0, since a policy may diverge
            on the ground, `restart` its episode, or `go on` with the controller.
        leave_out_every: Control steps between removals of fallen robots, which save time; by
            default no robot is removed. A removal changes the noise of the others.
    """
    robot = scenario.task.robot if isinstance(scenario, PreparedTask) else scenario.robot_of()
    controller = controller_of(controller, gait, robot)
    estimator = estimator_in_loop(controller, true_body_state=scenario.true_body_state)
    if isinstance(scenario, Scenario):
        scenario = PreparedTask.of(gait, scenario, controller)
    task, physics, _ = scenario
    generator = np.random.default_rng(seed)
    make = partial(BatchSimulator, task, physics, generator=generator, estimator=estimator)
    simulator, robots = make(n_robots=n_robots), np.arange(n_robots)
    if start is not None:
        simulator.restore(start)
    fell = np.full(n_robots, n_steps)
    memory = controller.begin(n_robots) if memory is None else memory
    for step in range(n_steps):
        # Remove fallen robots.
        fallen = fell[robots] < n_steps
        if leave_out_every and step % leave_out_every == 0 and fallen.any():
            up, state = np.flatnonzero(~fallen), simulator.state
            simulator, robots, fallen = make(n_robots=len(up)), robots[up], fallen[up]
            memory = memory[up]
            simulator.restore(state.of_robots(up))
        if len(robots) == 0:
            break

        # Apply the events, observe and act.
        for event in events:
            event(step, simulator)
        before, observation = simulator.state, simulator.observe()
        output = controller.advance(step, observation, memory)
        action, memory = output.action, output.memory
        if when_fallen == "rest":
            action = np.where(fallen[:, None], 0.0, action)

        # Step the simulation and record.
        outcome = simulator.step(action)
        fell[robots[outcome.terminated & ~fallen]] = step
        fallen = fallen | outcome.terminated
        after = simulator.state
        record = ControlStep(
            step, robots, before, observation, output, action, outcome, after, fallen
        )
        for observer in observers:
            observer.observe(record)
        if any(observer.done for observer in observers):
            break
        if when_fallen == "restart" and outcome.terminated.any():
            simulator.reset(np.flatnonzero(outcome.terminated))
            memory = np.where(outcome.terminated[:, None], np.nan, memory)
    return EpisodeEnd(fell, simulator.state)
