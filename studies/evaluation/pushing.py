"""Pushing walking robots: from every direction, at every speed, in every phase of the gait."""

from collections.abc import Sequence
from functools import partial

import numpy as np
import pandas as pd

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


def push_everywhere(
    gait: Gait,
    controller: Controller,
    scenario: Scenario,
    *,
    n_directions: int,
    speeds: Sequence[float],
    n_phases: int,
    n_steps: int,
    seed: int,
) -> pd.DataFrame:
    """Lets robots walk, pushes each once, and checks whether they walk `n_steps` later.

    A robot of each phase walks from near the default stance. It is copied in the instant of its
    phase, so that all its pushes meet the same state; sensor noise differs from then on.

    Returns a row for each direction (counted from straight ahead, to the left), speed and phase.
    The `end` of a robot that does not survive is its first failure, or `no_rhythm`.
    """
    world = World.of(gait, scenario, controller)
    walk = partial(episode, gait, controller, world, seed=np.random.default_rng(seed))
    # A robot of each phase walks until the instant of its phase.
    caught = _Caught(gait.states.index(gait.initial), n_phases)
    walk(n_robots=n_phases, n_steps=MOST_STEPS, observers=[caught])
    shape = n_directions, len(speeds), n_phases
    direction, speed, phase = np.unravel_index(np.arange(np.prod(shape)), shape)
    table = pd.DataFrame(
        {
            "direction (°)": 360.0 * direction / n_directions,
            "speed (m/s)": np.array(speeds)[speed],
            "phase": phase,
            "survived": False,
            "end": "no_rhythm",
        }
    )

    # Robots that walked until then are pushed, each in every direction at every speed.
    rows = np.flatnonzero(caught.there[phase])
    if len(rows):
        state = caught.state.of_robots(phase[rows])
        angles = 2.0 * np.pi * direction[rows] / n_directions
        push = horizontal(state.plant, angles, np.array(speeds)[speed[rows]])
        survival = _Survival(len(rows), n_steps)
        walk(
            n_robots=len(rows),
            n_steps=n_steps,
            observers=[survival],
            start=state.pushed(push),
            leave_out_every=WATCH,
        )
        fell = survival.failure >= 0
        table.loc[rows[fell], "end"] = np.array(FAILURES)[survival.failure[fell]]
        walks = rows[~fell & (survival.served / min(n_steps, LAST_STEPS) >= WALKS)]
        table.loc[walks, "survived"], table.loc[walks, "end"] = True, ""
    return table


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
    """Records each robot's first failure, -1 for none, and the rhythm served in the last steps."""

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
