"""Several gaits in one machine: which of them runs, and when it gives way to another.

The machine has the states of all gaits. Within a gait it goes as that gait's reward machine does;
from one gait to another it goes on request, at a step at which the feet suit both:

- The gait that runs takes the stance that ends one of its states. Of its stances only those count
  that are nearest to the new gait: fewest feet touch that should not, or the other way round.
- The new gait begins in the state that its own machine enters from the stance nearest to that of
  the feet. In the gaits' order the first of several is taken.
- A gait that stays in a state for `PATIENCE` times the commanded steps has lost its rhythm; it is
  waited for no more and gives way at once, to the nearest state whatever the stance.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.robots import quadruped
from glassgait.models.task.formula import N_STANCES, STANCES, stance_code
from glassgait.models.task.gait import Gait
from glassgait.models.task.reward_machine import (
    BoolArray,
    IntArray,
    MachineState,
    MachineStep,
    RewardMachine,
)

PATIENCE = 2.0
"""Multiple of the commanded steps in a state after which a gait is waited for no more."""

_FAR = quadruped.N_LEGS + 1
"""More feet than a robot has: how far states are that a gait never begins in."""


class GaitSwitch:
    """Steps the machine of several gaits, batch-wise, by table look-up.

    Attributes:
        gaits: The gaits, in the order of their numbers.
        patience: Multiple of the commanded steps in a state after which a gait is waited for no
            more; with 0 every request is met at once, whatever the feet do.
        gait: All of them as one gait, whose states are called `<gait> <state>`. Its commands are
            those that every gait is made for, and it begins as the first one does.
        machine: The reward machine of that gait, which stays in the gait that runs.
        distance: Feet by which a stance differs from the nearest one that enters a state of each
            gait (n_gaits, 16).
        entered: That state (n_gaits, 16).
        nearest: Least of these distances among the stances that end a state of the gait that runs,
            by that gait and the new one (n_gaits, n_gaits).
    """

    def __init__(self, gaits: Sequence[Gait], patience: float = PATIENCE) -> None:
        """
        Raises:
            InputError: if there is no gait, two have one name, or they ask for commands or for a
                clearance that do not go together.
        """
        self.gaits = tuple(gaits)
        self.patience = patience
        self.gait = _combined(self.gaits)
        self.machine = RewardMachine(self.gait)
        counts = [gait.n_states for gait in self.gaits]
        self._gait_of = np.repeat(np.arange(len(counts)), counts)
        offsets = np.cumsum([0, *counts[:-1]])
        self.distance = np.zeros((len(counts), N_STANCES), dtype=np.int64)
        self.entered = np.zeros((len(counts), N_STANCES), dtype=np.int64)
        for i, gait in enumerate(self.gaits):
            distances = _entry_distances(gait)
            self.distance[i] = distances.min(axis=0)
            self.entered[i] = offsets[i] + distances.argmin(axis=0)
        endings = [_ending(gait) for gait in self.gaits]
        self.nearest = np.array(
            [[own[stances].min(initial=_FAR) for own in self.distance] for stances in endings]
        )

    @property
    def n_states(self) -> int:
        """Number of states of all gaits, the length of the one-hot observation."""
        return self.gait.n_states

    def gait_of(self, state: IntArray) -> IntArray:
        """Returns which gait states (...) belong to."""
        return self._gait_of[state]

    def step(
        self,
        machine: MachineState,
        *,
        requested: IntArray,
        foot_contact: BoolArray,
        foot_height: Array,
        commanded_dwell: Array | IntArray,
    ) -> MachineStep:
        """Advances by one control step, and changes the gait where that is requested and suits.

        The transition that ends a gait is paid as any other. The new gait begins with 0 iterations
        and age 0; it runs for a control step at least.

        Args:
            machine: State after the previous step; its age counts from the gait's begin.
            requested: Number of the gait that is to run (...).
            foot_contact: Whether each foot touches, now or at the previous step (..., 4).
            foot_height: Height of each foot above the ground (..., 4; m).
            commanded_dwell: Commanded iterations in a state (...; control steps).

        Raises:
            ValueError: if a requested gait has no such number.
        """
        requested = np.asarray(requested)
        if np.any((requested < 0) | (requested >= len(self.gaits))):
            raise ValueError(
                f"gait switch: requested is {requested.tolist()}; it must be a number from 0 to "
                f"{len(self.gaits) - 1}"
            )
        step = self.machine.step(
            machine,
            foot_contact=foot_contact,
            foot_height=foot_height,
            commanded_dwell=commanded_dwell,
        )
        code, running = stance_code(foot_contact), self._gait_of[machine.state]
        near = self.distance[requested, code] <= self.nearest[running, requested]
        overlong = step.machine.iterations >= self.patience * np.asarray(commanded_dwell)
        asked = (requested != running) & (machine.age > 0)
        changes = asked & ((step.fired & near) | overlong)
        entered = MachineState(
            state=np.where(changes, self.entered[requested, code], step.machine.state),
            iterations=np.where(changes, 0, step.machine.iterations),
            age=np.where(changes, 0, step.machine.age),
        )
        return step._replace(machine=entered)


def _combined(gaits: tuple[Gait, ...]) -> Gait:
    names = [gait.name for gait in gaits]
    if not gaits or len(set(names)) < len(names):
        raise InputError(f"gaits are {', '.join(names) or 'none'}; name one or more, each once")
    least = max(gait.dwell[0] for gait in gaits)
    greatest = min(gait.dwell[1] for gait in gaits)
    if least > greatest:
        raise InputError(f"gaits {', '.join(names)}: no dwell is in the range of all; change one's")
    if len({gait.clearance for gait in gaits}) > 1:
        raise InputError(
            f"gaits {', '.join(names)}: ask for different clearances; give all of them one"
        )
    first = gaits[0]
    return Gait(
        name=" ".join(names),
        description=" or ".join(names),
        states=tuple(_called(gait, state) for gait in gaits for state in gait.states),
        initial=_called(first, first.initial),
        faults=tuple(_called(gait, state) for gait in gaits for state in gait.faults),
        transitions=tuple(
            replace(edge, source=_called(gait, edge.source), target=_called(gait, edge.target))
            for gait in gaits
            for edge in gait.transitions
        ),
        clearance=first.clearance,
        dwell=(least, greatest),
        max_speed=min(gait.max_speed for gait in gaits),
        max_yaw_rate=min(gait.max_yaw_rate for gait in gaits),
    )


def _called(gait: Gait, state: str) -> str:
    return f"{gait.name} {state}"


def _entry_distances(gait: Gait) -> IntArray:
    """Counts by state and stance (n_states, 16) the feet that differ from the nearest stance in
    which the gait's own machine enters the state; states at fault are out of reach."""
    differing = np.sum(STANCES[:, None] != STANCES[None], axis=2)
    distances = np.full((gait.n_states, N_STANCES), _FAR)
    for edge, (i, state) in product(gait.transitions, enumerate(gait.states)):
        if edge.target == state and state not in gait.faults:
            own = differing[np.array(edge.when.table)].min(axis=0)
            distances[i] = np.minimum(distances[i], own)
    return distances


def _ending(gait: Gait) -> BoolArray:
    """Returns the stances (16) that end one of a gait's states and lead to no fault."""
    tables = [edge.when.table for edge in gait.transitions if edge.target not in gait.faults]
    return np.any(np.array(tables, dtype=bool).reshape(-1, N_STANCES), axis=0)
