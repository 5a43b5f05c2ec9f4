"""Pushing walking robots: from every direction, at every speed, in every phase of the gait."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.task import TaskState
from glassgait.models.arrays import Array
from glassgait.models.policies.controller import Controller
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait
from glassgait.models.task.termination import FAILURES
from glassgait.studies.common.episode import ControlStep, Observer, World, episode

FIRST_STEPS = 150  # control steps from standing until strides are watched
MOST_STEPS = 450  # control steps until the phases must be caught; later a new command may come
LAST_STEPS = round(1.0 / CONTROL_PERIOD)  # control steps in which survivors must walk in the end
WALKS = 0.5  # share of the commanded rhythm that counts as walking
WATCH = 25  # control steps after which robots that fell are left out, to save time


@dataclass(frozen=True)
class PushGrid:
    """The pushes: every direction with every speed in every phase.

    Attributes:
        directions: Angles from straight ahead, to the left (n_directions,; rad).
        speeds: Velocities that are added to the trunk's (n_speeds,; m/s).
        n_phases: Number of instants of the gait's cycle, equally far apart.
    """

    directions: Array
    speeds: Array
    n_phases: int

    @property
    def shape(self) -> tuple[int, int, int]:
        """Numbers of directions, speeds and phases."""
        return len(self.directions), len(self.speeds), self.n_phases


class Pushed(NamedTuple):
    """The ends of the robots, each array of the grid's shape.

    Attributes:
        survived: Whether a robot still walked in the end.
        failure: Index of its first failure in `FAILURES`; -1 for none.
    """

    survived: NDArray[np.bool_]
    failure: NDArray[np.int64]

    def failure_counts(self) -> dict[str, int]:
        """Counts the ends of robots that did not survive: first failure, or loss of the rhythm."""
        counts = {name: int(np.sum(self.failure == i)) for i, name in enumerate(FAILURES)}
        return counts | {"no_rhythm": int(np.sum(~self.survived & (self.failure < 0)))}


def push_everywhere(
    gait: Gait,
    controller: Controller,
    scenario: Scenario,
    grid: PushGrid,
    *,
    n_steps: int,
    seed: int,
) -> Pushed:
    """Lets robots walk, pushes each once, and checks whether they walk `n_steps` later.

    A robot of each phase walks from near the default stance. It is copied in the instant of its
    phase, so that all its pushes meet the same state; sensor noise differs from then on.
    """
    world = World.of(gait, scenario, controller)
    walk = partial(episode, gait, controller, world, seed=np.random.default_rng(seed))
    # A robot of each phase walks until the instant of its phase.
    caught = _Caught(gait.states.index(gait.initial), grid.n_phases)
    walk(n_robots=grid.n_phases, n_steps=MOST_STEPS, observers=[caught])

    # Robots that walked until then are pushed, each in every direction at every speed.
    direction, speed, phase = np.unravel_index(np.arange(np.prod(grid.shape)), grid.shape)
    rows = np.flatnonzero(caught.there[phase])
    survived, failure = np.zeros(len(phase), dtype=bool), np.full(len(phase), -1)
    if len(rows):
        state = caught.state.of_robots(phase[rows])
        push = horizontal(state.plant, grid.directions[direction[rows]], grid.speeds[speed[rows]])
        survival = _Survival(len(rows), n_steps)
        walk(
            n_robots=len(rows),
            n_steps=n_steps,
            observers=[survival],
            start=state.pushed(push),
            leave_out_every=WATCH,
        )
        rhythm = survival.served / min(n_steps, LAST_STEPS)
        survived[rows] = (survival.failure < 0) & (rhythm >= WALKS)
        failure[rows] = survival.failure
    return Pushed(survived.reshape(grid.shape), failure.reshape(grid.shape))


class _Caught(Observer):
    """Catches a robot of each phase in the instant of its phase.

    Attributes:
        there: Which robots were caught (n,). The others fell before, or never completed a stride.
    """

    def __init__(self, initial: int, n_phases: int) -> None:
        self.there = np.zeros(n_phases, dtype=bool)
        self._initial = initial
        self._phases = np.arange(n_phases) / n_phases
        self._entries = np.full((n_phases, 2), -1)
        self._state: TaskState | None = None

    def observe(self, step: ControlStep) -> None:
        # A stride lasts from one entry of the initial state to the next.
        entries, number = self._entries, step.step
        entered = step.outcome.fired & (step.after.memory.machine.state == self._initial)
        came = entered & (number >= FIRST_STEPS)
        entries[came & (entries[:, 0] >= 0) & (entries[:, 1] < 0), 1] = number
        entries[came & (entries[:, 0] < 0), 0] = number

        # The phases are instants of the next stride, if it takes as long.
        due = entries[:, 1] + np.rint(self._phases * (entries[:, 1] - entries[:, 0]))
        now = (entries[:, 1] >= 0) & (number >= due) & ~step.fallen & ~self.there
        caught = np.flatnonzero(now)
        before = step.before if self._state is None else self._state
        self._state = before.with_robots(caught, step.after.of_robots(caught))
        self.there |= now
        self.done = bool((self.there | step.fallen).all())

    @property
    def state(self) -> TaskState:
        """The robots in these instants."""
        # The next command comes when the episode is some seconds older than all that follows.
        steps = np.ones(len(self.there), dtype=np.int64)
        assert self._state is not None
        return self._state._replace(steps=steps)


class _Survival(Observer):
    """Records each robot's first failure, as `Pushed`, and the rhythm served in the last steps."""

    def __init__(self, n_robots: int, n_steps: int) -> None:
        self.failure, self.served = np.full(n_robots, -1), np.zeros(n_robots)
        self._last = n_steps - LAST_STEPS

    def observe(self, step: ControlStep) -> None:
        rows = step.robots
        first = step.outcome.terminated & (self.failure[rows] < 0)
        self.failure[rows[first]] = step.outcome.failures[first].argmax(axis=1)
        if step.step >= self._last:
            self.served[rows] += step.outcome.served_dwell


def horizontal(plant: Array, direction: Array, speed: Array) -> Array:
    """Returns velocities (n, 3; m/s, world frame) of some speeds (n,; m/s) along the ground.

    Directions (n,; rad) are angles from where the robots of plant states (n, 37) face, to the left.
    """
    rotation = kinematics.rotation_matrix(plant[:, quadruped.QUATERNION])
    angle = np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0]) + direction
    return speed[:, None] * np.stack([np.cos(angle), np.sin(angle), np.zeros(len(plant))], axis=1)


@dataclass(frozen=True)
class Basin:
    """The pushes that one policy survives: counts of robots (n_directions, n_speeds), and of the
    ends of the others."""

    grid: PushGrid
    survived: Array
    failures: Mapping[str, int]

    @property
    def shares(self) -> Array:
        """Shares of phases in which robots survive (n_directions, n_speeds)."""
        return self.survived / self.grid.n_phases

    def survived_up_to(self, share: float) -> float:
        """Returns the greatest speed (m/s) up to which a share of the pushes is survived, or 0."""
        holds = np.logical_and.accumulate(self.shares.mean(axis=0) >= share)
        return float(self.grid.speeds[holds].max(initial=0.0))
