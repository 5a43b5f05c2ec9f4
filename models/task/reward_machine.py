"""The reward machine of a gait, compiled to tables and stepped for any number of robots at once.

It is a Mealy machine over the feet's contacts. It tracks the phase of the gait, and multiplies the
reward in the stance that ends a phase (paper, Section II-A; DeFazio et al., 2024).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.robots import quadruped
from glassgait.models.task.gait import N_STANCES, Gait, stance_code

TRANSITION_MULTIPLIER = 1000.0  # factor on the plain reward of a step with a transition

IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


class MachineState(NamedTuple):
    """The state of each robot's machine."""

    state: IntArray  # index among the gait's states (...)
    iterations: IntArray  # control steps spent in it (...), 0 at the step that entered it
    age: IntArray  # control steps since the episode's start (...)


class MachineStep(NamedTuple):
    """The outcome of one control step."""

    machine: MachineState  # after this step's propositions
    fired: BoolArray  # whether a transition fired (...)
    # Dwell of the transition that fired (...; control steps), 0 without one. Its sum over an
    # episode divided by the episode's length is the share of the rhythm that the robot kept.
    served_dwell: Array
    multiplier: Array  # factor on the plain reward (...)


class RewardMachine:
    """Steps a gait's reward machine, batch-wise, by table look-up."""

    def __init__(self, gait: Gait) -> None:
        self.gait = gait
        self._one_hot = np.eye(gait.n_states)
        self._initial = gait.states.index(gait.initial)
        self._is_fault = np.array([state in gait.faults for state in gait.states])
        left = {transition.source for transition in gait.transitions}
        self._is_sink = self._is_fault & [state not in left for state in gait.states]

        # The transition of each state and stance; the last row of each array is for no transition.
        count = len(gait.transitions)
        self._edge = np.full((gait.n_states, N_STANCES), count)
        self._target = np.zeros(count + 1, dtype=np.int64)
        self._fires = np.append(np.ones(count, dtype=bool), False)
        self._dwell = np.zeros(count + 1)
        self._grace = np.zeros(count + 1, dtype=np.int64)
        self._swing = np.zeros((count + 1, quadruped.N_LEGS), dtype=bool)
        for i, transition in enumerate(gait.transitions):
            source = gait.states.index(transition.source)
            self._edge[source, np.array(transition.when.table)] = i
            self._target[i] = gait.states.index(transition.target)
            self._dwell[i] = transition.dwell
            self._grace[i] = transition.grace
            self._swing[i] = transition.when.swing_feet

    def initial(self, shape: tuple[int, ...] = ()) -> MachineState:
        """Returns the state at an episode's start, before its first propositions."""
        zero = np.zeros(shape, dtype=np.int64)
        state = np.full(shape, self._initial, dtype=np.int64)
        return MachineState(state=state, iterations=zero, age=zero.copy())

    def step(
        self,
        machine: MachineState,
        *,
        foot_contact: BoolArray,
        foot_height: Array,
        commanded_dwell: Array | IntArray,
        difficulty: float = 1.0,
        moves: BoolArray | bool = True,
    ) -> MachineStep:
        """Advances by one control step.

        A transition fires when its formula holds for the contacts, every foot that the formula
        keeps in the air is higher than the gait's clearance, and the machine has been in its state
        for the transition's share of the commanded iterations.

        Args:
            foot_contact: Whether each foot touches, now or at the previous step (..., 4).
            foot_height: Height of each foot above the ground (..., 4; m).
            commanded_dwell: Commanded iterations in a state (...; control steps).
            difficulty: Factor on a transition's dwell and clearance, and divisor of its grace;
                training raises it to 1.
            moves: Which machines (...) take the step; time does not pass for the others.
        """
        # The transition of the stance, and whether it fires.
        edge = self._edge[machine.state, stance_code(foot_contact)]
        spent = machine.iterations + moves
        clearance = difficulty * self.gait.clearance
        lifted = ((foot_height >= clearance) | ~self._swing[edge]).all(axis=-1)
        dwell = self._dwell[edge] * commanded_dwell
        in_time = (spent >= difficulty * dwell) & (difficulty * machine.age >= self._grace[edge])
        fired = self._fires[edge] & lifted & in_time & moves

        # The next state, and the factor on the reward.
        state = np.where(fired, self._target[edge], machine.state)
        after = MachineState(state, np.where(fired, 0, spent), machine.age + moves)
        multiplier = np.where(fired, TRANSITION_MULTIPLIER, 1.0)
        at_fault = self._is_fault[machine.state] | self._is_fault[state]
        return MachineStep(
            machine=after,
            fired=fired,
            served_dwell=np.where(fired & ~at_fault, dwell, 0.0),
            multiplier=np.where(at_fault, 0.0, multiplier),
        )

    def in_sink(self, state: IntArray) -> BoolArray:
        """Returns which states (...) are faults that no transition leaves."""
        return self._is_sink[state]

    def one_hot(self, state: IntArray) -> Array:
        """Encodes states (...) as observed, (..., n_states)."""
        return self._one_hot[state]
