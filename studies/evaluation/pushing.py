"""Pushes of walking robots: in every direction, at every speed, in every phase of the gait."""

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
from glassgait.studies.common.episode import ControlStep, Observer, PreparedTask, episode

FIRST_STEPS = 150  # control steps from standing to the first stride that is timed
MOST_STEPS = 450  # control steps to reach the phases in; later, a new command may come
LAST_STEPS = round(1.0 / CONTROL_PERIOD)  # last control steps, in which survivors must walk
FREE_STRIDE = 25  # control steps that count as a stride of a gait without transitions
WALKS = 0.5  # share of the commanded rhythm that counts as walking
LEAVE_OUT_EVERY = 25  # control steps after which fallen robots are left out, to save time


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
    """Pushes each walking robot once, and checks whether it walks `n_steps` later.

    One robot per phase walks from near the default stance. It is copied at the instant of its
    phase, so that all its pushes start from the same state; sensor noise differs from then on. A
    gait without transitions has no rhythm to keep: its robots survive if they do not fall.

    Returns one row per direction (from straight ahead, to the left), speed and phase. The `end` of
    a robot that does not survive is its first failure, or `no_rhythm`.
    """
    world = PreparedTask.of(gait, scenario, controller)
    walk = partial(episode, gait, controller, world, seed=np.random.default_rng(seed))
    # Let one robot per phase walk until the instant of its phase.
    phases = _PhaseStates(gait, n_phases)
    walk(n_robots=n_phases, n_steps=MOST_STEPS, observers=[phases])
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

    # Push copies of the robots that reached their phase, in every direction at every speed.
    rows = np.flatnonzero(phases.reached[phase])
    if len(rows):
        state = phases.state.of_robots(phase[rows])
        angles = 2.0 * np.pi * direction[rows] / n_directions
        push = horizontal(state.plant, angles, np.array(speeds)[speed[rows]])
        survival = _Survival(len(rows), n_steps)
        walk(
            n_robots=len(rows),
            n_steps=n_steps,
            observers=[survival],
            start=state.pushed(push),
            memory=phases.memory[phase[rows]],
            leave_out_every=LEAVE_OUT_EVERY,
        )
        fell = survival.failure >= 0
        table.loc[rows[fell], "end"] = np.array(FAILURES)[survival.failure[fell]]
        rhythmic = survival.served / min(n_steps, LAST_STEPS) >= WALKS
        walks = rows[~fell & (rhythmic | (not gait.transitions))]
        table.loc[walks, "survived"], table.loc[walks, "end"] = True, ""
    return table


class _PhaseStates(Observer):
    """Records each robot's state at the instant of its phase.

    Attributes:
        reached: True for robots that reached their phase (n,). The others fell before, or never
            completed a stride.
        memory: The controller's memory at these instants (n, n_memory).
    """

    def __init__(self, gait: Gait, n_phases: int) -> None:
        self.reached = np.zeros(n_phases, dtype=bool)
        self.memory = np.full((n_phases, 1), np.nan)
        self._initial = gait.states.index(gait.initial)
        self._phases = np.arange(n_phases) / n_phases
        self._entries = np.full((n_phases, 2), -1)
        if not gait.transitions:
            self._entries[:] = FIRST_STEPS, FIRST_STEPS + FREE_STRIDE
        self._state: TaskState | None = None

    def observe(self, step: ControlStep) -> None:
        # A stride lasts from one entry of the initial state to the next.
        entries, number = self._entries, step.step
        entered = step.outcome.fired & (step.after.memory.machine.state == self._initial)
        entered &= number >= FIRST_STEPS
        entries[entered & (entries[:, 0] >= 0) & (entries[:, 1] < 0), 1] = number
        entries[entered & (entries[:, 0] < 0), 0] = number

        # The phases are instants of the next stride, assuming that it takes as long.
        due = entries[:, 1] + np.rint(self._phases * (entries[:, 1] - entries[:, 0]))
        now = (entries[:, 1] >= 0) & (number >= due) & ~step.fallen & ~self.reached
        robots = np.flatnonzero(now)
        before = step.before if self._state is None else self._state
        self._state = before.with_robots(robots, step.after.of_robots(robots))
        self.memory = np.where(now[:, None], step.output.memory, self.memory)
        self.reached |= now
        self.done = bool((self.reached | step.fallen).all())

    @property
    def state(self) -> TaskState:
        """The robots' states at these instants."""
        # Restart the count of steps, so that no new command comes after the push.
        steps = np.ones(len(self.reached), dtype=np.int64)
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
    """Returns horizontal velocities (n, 3; m/s, world frame) of given speeds (n,; m/s).

    Directions (n,; rad) are angles from the headings of plant states (n, 37), to the left.
    """
    rotation = kinematics.rotation_matrix(plant[:, quadruped.QUATERNION])
    angle = np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0]) + direction
    return speed[:, None] * np.stack([np.cos(angle), np.sin(angle), np.zeros(len(plant))], axis=1)
