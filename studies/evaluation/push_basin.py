"""Pushing walking robots: from every direction, at every speed, in every phase of the gait."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glassgait.diagrams.batch import BatchSimulator
from glassgait.diagrams.engines import make_physics
from glassgait.diagrams.physics import Physics
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.task_config import TaskConfig
from glassgait.diagrams.task_state import TaskState
from glassgait.models.arrays import Array
from glassgait.models.policies.controller import AlternatingController, estimator_in_loop
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait
from glassgait.models.task.termination import FAILURES

FIRST_STEPS = 150
"""Control steps from standing until strides are watched."""

MOST_STEPS = 450
"""Control steps in which a robot must have taken its strides: no new command comes until then."""

LAST_STEPS = round(1.0 / CONTROL_PERIOD)
"""Control steps at the end in which a robot must walk to have survived."""

WALKS = 0.5
"""Share of the commanded rhythm that is called walking."""

WATCH = 25
"""Control steps after which robots that fell are left out, so that they cost nothing more."""


@dataclass(frozen=True)
class PushGrid:
    """The pushes: every direction with every speed in every phase.

    Attributes:
        directions: Angles from straight ahead, to the left (n_directions,; rad).
        speeds: What a push adds to the trunk's velocity (n_speeds,; m/s).
        n_phases: Instants of the gait's cycle, equally far apart.
    """

    directions: Array
    speeds: Array
    n_phases: int

    @property
    def shape(self) -> tuple[int, int, int]:
        """How many directions, speeds and phases there are."""
        return len(self.directions), len(self.speeds), self.n_phases


class Pushed(NamedTuple):
    """What became of the robots, each array as the grid's shape.

    Attributes:
        survived: Whether a robot still walked in the end.
        failure: Index of its first failure in `FAILURES`; -1 for none.
    """

    survived: NDArray[np.bool_]
    failure: NDArray[np.int64]


class _Walk:
    """One policy in one world."""

    def __init__(self, gait: Gait, policy: AlternatingController, scenario: Scenario, seed: int):
        self.policy = policy
        self.generator = np.random.default_rng(seed)
        self.entered = gait.states.index(gait.initial)
        self._task = TaskConfig.of_scenario(gait, scenario, policy)
        self._physics: Physics = make_physics(scenario.station)

    def simulator(self, n_robots: int, state: TaskState | None = None) -> BatchSimulator:
        simulator = BatchSimulator(
            self._task,
            self._physics,
            n_robots=n_robots,
            generator=self.generator,
            estimator=estimator_in_loop(self.policy),
        )
        if state is not None:
            simulator.restore(state)
        return simulator


def push_everywhere(
    gait: Gait,
    policy: AlternatingController,
    scenario: Scenario,
    grid: PushGrid,
    *,
    n_steps: int,
    seed: int,
) -> Pushed:
    """Lets robots walk, pushes each once, and looks whether they walk some seconds later.

    A robot of each phase walks from near the default stance. It is copied in the instant of its
    phase, so that all its pushes meet the same state; sensor noise differs from then on.

    Args:
        gait: The gait.
        policy: The controller.
        scenario: The world, with the command that all follow.
        grid: The pushes.
        n_steps: Control steps from the push to the end.
        seed: Seed of initial states and noise.
    """
    walk = _Walk(gait, policy, scenario, seed)
    walkers, walks = _walkers(walk, grid.n_phases)
    pushes = np.stack(np.meshgrid(*map(np.arange, grid.shape), indexing="ij"), -1).reshape(-1, 3)
    rows = np.flatnonzero(walks[pushes[:, 2]])
    survived = np.zeros(len(pushes), dtype=bool)
    failure = np.full(len(pushes), -1)
    if len(rows):
        direction, speed, phase = pushes[rows].T
        state = _picked(walkers, phase)
        angle = _headings(state.plant) + grid.directions[direction]
        push = np.stack([np.cos(angle), np.sin(angle), np.zeros(len(rows))], axis=1)
        pushed = state.pushed(grid.speeds[speed][:, None] * push)
        survived[rows], failure[rows] = _walk_on(walk, pushed, n_steps)
    return Pushed(survived.reshape(grid.shape), failure.reshape(grid.shape))


def _walkers(walk: _Walk, n_phases: int) -> tuple[TaskState, NDArray[np.bool_]]:
    """Lets a robot of each phase walk until the instant of its phase.

    Returns:
        The robots in these instants, and which of them walk: the others fell before, or never came
        through the machine's states.
    """
    simulator = walk.simulator(n_phases)
    caught = {name: values.copy() for name, values in simulator.state.as_arrays().items()}
    entries = np.full((n_phases, 2), -1)
    fell, there = np.zeros(n_phases, dtype=bool), np.zeros(n_phases, dtype=bool)
    for step in range(MOST_STEPS):
        action = walk.policy.advance(step, simulator.observe(), None).action
        outcome = simulator.step(np.where(fell[:, None], 0.0, action))
        fell |= outcome.terminated
        state = simulator.state
        came = outcome.fired & (state.machine.state == walk.entered) & (step >= FIRST_STEPS)
        entries[came & (entries[:, 0] >= 0) & (entries[:, 1] < 0), 1] = step
        entries[came & (entries[:, 0] < 0), 0] = step
        length = entries[:, 1] - entries[:, 0]
        due = entries[:, 1] + np.rint(np.arange(n_phases) / n_phases * length)
        now = (entries[:, 1] >= 0) & (step >= due) & ~fell & ~there
        for name, values in state.as_arrays().items():
            caught[name][now] = values[now]
        there |= now
        if (there | fell).all():
            break
    # The next command comes when the episode is some seconds older than all that follows.
    caught["steps"] = np.ones(n_phases, dtype=np.int64)
    return TaskState.from_arrays(caught), there


def _walk_on(
    walk: _Walk, state: TaskState, n_steps: int
) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Lets robots walk on, and tells which of them do so in the end and how the others failed."""
    n = len(state.steps)
    failure, served = np.full(n, -1), np.zeros(n)
    rows = np.arange(n)
    simulator = walk.simulator(n, state)
    for step in range(n_steps):
        up = failure[rows] < 0
        if step % WATCH == 0 and not up.all():
            rows, state = rows[up], _picked(simulator.state, np.flatnonzero(up))
            simulator, up = walk.simulator(len(rows), state), up[up]
        if len(rows) == 0:
            break
        action = walk.policy.advance(step, simulator.observe(), None).action
        outcome = simulator.step(np.where(up[:, None], action, 0.0))
        first = outcome.terminated & up
        failure[rows[first]] = outcome.failures[first].argmax(axis=1)
        if step >= n_steps - LAST_STEPS:
            served[rows] += outcome.served_dwell
    rhythm = served / min(n_steps, LAST_STEPS)
    return (failure < 0) & (rhythm >= WALKS), failure


def _picked(state: TaskState, index: NDArray[np.int64]) -> TaskState:
    arrays: dict[str, Any] = {name: values[index] for name, values in state.as_arrays().items()}
    return TaskState.from_arrays(arrays)


def _headings(plant: Array) -> Array:
    rotation = kinematics.rotation_matrix(plant[:, quadruped.QUATERNION])
    return np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0])


def failure_counts(pushed: Pushed) -> dict[str, int]:
    """Counts how robots ended that did not survive: by their first failure, or without rhythm."""
    counts = {name: int(np.sum(pushed.failure == i)) for i, name in enumerate(FAILURES)}
    return counts | {"no_rhythm": int(np.sum(~pushed.survived & (pushed.failure < 0)))}
