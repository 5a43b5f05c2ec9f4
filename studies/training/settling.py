"""What changes from one stride to the next as a cost, so that gaits settle."""

import numpy as np

from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.task_state import BoolArray, TaskState
from glassgait.models.arrays import Array
from glassgait.models.policies.controller import Controller
from glassgait.models.task.gait import Gait
from glassgait.studies.common.episode import ControlStep, Observer, episode
from glassgait.studies.common.loop_state import NAMES, loop_state

COMPARED = np.flatnonzero([name != "height" for name in NAMES])
"""What strides are compared by: pose, speeds and previous action, but not the height above the
origin, which changes as a robot climbs."""

OBSERVED_SHARE = 0.1
"""Factor on coordinates that a critic observes: they are counted in small units."""


class Settling:
    """Remembers where robots last entered the machine's first state.

    A robot that enters it again pays for how far it then is from there: `weight` times the mean
    over its coordinates of the absolute change, each counted in a part of what a gait sways. The
    cost is 0 for a gait that repeats itself, and its least under noise is that of a gait from which
    noise leads away least: one whose stride map has a small spectral radius. It pays nothing if
    its command has changed on the way.

    Attributes:
        weight: Weight of the cost beside the task's reward, before its scale.
    """

    def __init__(self, gait: Gait, n_robots: int, weight: float) -> None:
        """
        Args:
            gait: The gait.
            n_robots: Number of robots.
            weight: Weight of the cost.
        """
        self.weight = weight
        self._entered = gait.states.index(gait.initial)
        self._last = np.zeros((n_robots, len(COMPARED)))
        # NaN, which equals nothing, where there is no last stride to compare with.
        self._command = np.full((n_robots, 3), np.nan)

    def cost(self, state: TaskState, fired: BoolArray, ended: BoolArray) -> Array:
        """Compares robots that enter the machine's first state with how they did so last.

        Args:
            state: Where a control step took robots.
            fired: Whether a transition of the machine fired in it (n,).
            ended: Whether the episode ended with it (n,); the next begins without a last stride.

        Returns:
            The cost (n,): the weight times the mean absolute change; 0 of robots that are not
            compared.
        """
        command = np.column_stack(state.command)
        self._forget(ended | (command != self._command).any(axis=1))
        came = np.flatnonzero(fired & (state.machine.state == self._entered) & ~ended)
        compared = np.isfinite(self._command[came]).all(axis=1)
        now = loop_state(state.of_robots(came))[:, COMPARED]
        change = np.abs(now - self._last[came]).mean(axis=1)
        self._last[came], self._command[came] = now, command[came]
        cost = np.zeros(len(ended))
        cost[came] = np.where(compared, self.weight * change, 0.0)
        return cost

    def observed(self) -> Array:
        """Returns what a critic must observe to foresee the cost (n, 45).

        These are whether the next entry is paid for, and the last stride.
        """
        known = np.isfinite(self._command).all(axis=1, keepdims=True)
        paid = (known & (self.weight > 0.0)).astype(np.float64)
        return np.concatenate([paid, OBSERVED_SHARE * self._last], axis=1)

    def to_arrays(self) -> dict[str, Array]:
        """Returns all that a checkpoint needs."""
        return {"last_stride": self._last, "last_command": self._command}

    def restore(self, arrays: dict[str, Array]) -> None:
        """Continues from what `to_arrays` returned.

        Raises:
            ValueError: if that is of another number of robots, or not finite.
        """
        last, command = arrays["last_stride"], arrays["last_command"]
        shapes = self._last.shape, self._command.shape
        if (last.shape, command.shape) != shapes or not np.isfinite(last).all():
            raise ValueError("these are not strides of as many robots")
        self._last, self._command = last.copy(), command.copy()

    def _forget(self, robots: BoolArray) -> None:
        self._last[robots], self._command[robots] = 0.0, np.nan


class _Paid(Observer):
    """Adds up what robots pay, and their control steps, until they fall."""

    def __init__(self, settling: Settling) -> None:
        self.cost, self.n_steps = 0.0, 0
        self._settling = settling

    def observe(self, step: ControlStep) -> None:
        self.cost += self._settling.cost(step.after, step.outcome.fired, step.fallen).sum()
        self.n_steps += int((~step.fallen).sum())
        self.done = bool(step.fallen.all())


def settling_cost(
    gait: Gait, controller: Controller, weight: float, *, n_robots: int, n_steps: int, seed: int
) -> float:
    """Returns what robots pay in an episode without noise, on average.

    A robot that falls is counted as if it had gone on, so that falling saves nothing.

    Args:
        gait: The gait.
        controller: What moves them.
        weight: Weight of the cost.
        n_robots: Number of robots, each with commands of its own.
        n_steps: Control steps of the episode.
        seed: Seed of starts and commands.
    """
    paid = _Paid(Settling(gait, n_robots, weight))
    quiet = Scenario(sensor_noise=0.0)
    episode(
        gait, controller, quiet, n_robots=n_robots, n_steps=n_steps, seed=seed, observers=[paid]
    )
    return n_steps * paid.cost / max(paid.n_steps, 1)
