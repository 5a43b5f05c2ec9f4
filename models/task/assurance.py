"""Runtime assurance: a student acts while its observations are of those it was made for.

This is the Simplex architecture: a monitor of known form hands over to a trusted controller as soon
as the other one leaves its region, and back once the robot has been inside again for a while.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.settings import Count, NotNegative, Settings
from glassgait.models.task.observation import machine_state_entries

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class EnsembleDisagreement:
    """How far the models of an ensemble disagree about the action.

    Attributes:
        measure: Maps observations (..., n) to the disagreement (...), 0 or more.
        usual: The least and the greatest that are usual in each state of the machine (2, n_states).
    """

    measure: Callable[[Array], Array]
    usual: Array


@dataclass(frozen=True)
class Region:
    """Boxes of observations, one for each state of the gait's machine.

    Attributes:
        names: Names of the observations (n), in order.
        lower: Least values in each state (n_states, n), in the observation's own scaled units.
        upper: Greatest ones (n_states, n).
        disagreement: What else must be as usual inside of the region, if anything.
    """

    names: tuple[str, ...]
    lower: Array
    upper: Array
    disagreement: EnsembleDisagreement | None = None

    def __post_init__(self) -> None:
        """
        Raises:
            InputError: if the corners do not have a row a state and a column an observation, a
                range is empty or not finite, or the disagreement is not of every state.
        """
        one_hot = machine_state_entries(self.names)
        shape = (one_hot.stop - one_hot.start, len(self.names))
        if not self.lower.shape == self.upper.shape == shape:
            raise InputError(
                f"region: corners are of shape {self.lower.shape} and {self.upper.shape}; give "
                f"{shape[0]} states of {shape[1]} observations"
            )
        wrong = ~(np.isfinite(self.lower) & np.isfinite(self.upper) & (self.lower <= self.upper))
        if wrong.any():
            state, index = np.argwhere(wrong)[0]
            raise InputError(
                f"region: {self.names[index]!r} in state {state} goes from "
                f"{self.lower[state, index]:g} to {self.upper[state, index]:g}; give the least, "
                "then the greatest"
            )
        if self.disagreement and not (
            self.disagreement.usual.shape == (2, shape[0])
            and np.isfinite(self.disagreement.usual).all()
            and (self.disagreement.usual[0] <= self.disagreement.usual[1]).all()
        ):
            raise InputError(
                f"region: usual disagreement is {self.disagreement.usual.tolist()}; give the "
                f"least of {shape[0]} states, then the greatest"
            )

    def overruns(self, observation: Array) -> Array:
        """Returns how far each observation is outside of the box of the machine's state.

        Args:
            observation: Observations (..., n).

        Returns:
            Overruns (..., n) in widths of the ranges: 0 inside; infinite beyond a range without
            width, and where an observation is not finite. With the disagreement (..., n + 1): the
            last is how far it exceeds what is usual, in widths of that range, too.
        """
        state = np.argmax(observation[..., machine_state_entries(self.names)], axis=-1)
        lower, upper = self.lower[state], self.upper[state]
        excess = np.maximum(lower - observation, observation - upper)
        with np.errstate(divide="ignore", invalid="ignore"):
            widths = excess / (upper - lower)
            if self.disagreement:
                least, greatest = self.disagreement.usual[:, state]
                disagreeing = self.disagreement.measure(observation) - greatest
                excess = np.append(excess, disagreeing[..., None], axis=-1)
                widths = np.append(widths, (disagreeing / (greatest - least))[..., None], axis=-1)
        return np.where(np.isfinite(excess), np.where(excess <= 0.0, 0.0, widths), np.inf)

    def overrun(self, observation: Array) -> Array:
        """Returns the greatest of the overruns (...) of observations (..., n)."""
        return self.overruns(observation).max(axis=-1)


@dataclass(frozen=True)
class Hysteresis(Settings):
    """When to call the expert, and when to let it go.

    Attributes:
        limit: Overrun beyond which the expert acts at once (widths).
        return_limit: Overrun that counts as inside again (widths), at most `limit`.
        return_steps: Control steps in a row inside, after which the student acts again.
    """

    title: ClassVar[str] = "hysteresis"

    limit: NotNegative
    return_limit: NotNegative
    return_steps: Count = 25

    def __post_init__(self) -> None:
        """
        Raises:
            InputError: if a value is out of range, or the expert would be let go outside.
        """
        super().__post_init__()
        if self.return_limit > self.limit:
            raise InputError(
                f"hysteresis: return_limit is {self.return_limit:g}; give one of at most limit = "
                f"{self.limit:g}"
            )


class MonitorState(NamedTuple):
    """State of the monitor that chooses between expert and student.

    Attributes:
        expert_acts: Whether the expert acts (...).
        calm_steps: Control steps in a row inside of the return limit (...).
    """

    expert_acts: BoolArray
    calm_steps: NDArray[np.int64]


def initial_monitor(shape: tuple[int, ...]) -> MonitorState:
    """Returns the state (...) before an episode's first observation."""
    return MonitorState(np.zeros(shape, dtype=bool), np.zeros(shape, dtype=np.int64))


def step_monitor(state: MonitorState, overrun: Array, hysteresis: Hysteresis) -> MonitorState:
    """Decides which policy acts at a control step.

    Args:
        state: The monitor's state after the step before (...).
        overrun: Overruns of this step's observations (...).
        hysteresis: The limits.
    """
    calm_steps = np.where(overrun <= hysteresis.return_limit, state.calm_steps + 1, 0)
    kept = state.expert_acts & (calm_steps < hysteresis.return_steps)
    # Written so that an overrun that is not a number calls the expert.
    return MonitorState(kept | ~(overrun <= hysteresis.limit), calm_steps)
