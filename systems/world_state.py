"""Counts how far a robot has been moved back onto the tile of ground that is laid."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, InputPort, LeafSystem, OutputPort

from glassgait.models.arrays import Array
from glassgait.models.robots import quadruped


class WorldState(LeafSystem):
    """Gives the robot's state where it has gone to, on ground that repeats.

    .. pydrake_system::

        name: WorldState
        input_ports:
        - plant_state
        output_ports:
        - state

    Inputs: plant_state (37), with the trunk on the tile that is laid.
    Outputs: state (37), the same with the trunk where it has gone to.
    State: how far the trunk has been moved back in all (3, m), changed from outside alone, by
    `glassgait.diagrams.plant_state.recenter`. Feedthrough: yes.
    """

    def __init__(self) -> None:
        super().__init__()
        size = quadruped.N_POSITIONS + quadruped.N_VELOCITIES
        self._away = self.DeclareDiscreteState(3)
        self._plant_state_port = self.DeclareVectorInputPort("plant_state", size)
        self._state_port = self.DeclareVectorOutputPort(
            name="state",
            size=size,
            calc=self._calc_state,
            prerequisites_of_calc={self.all_input_ports_ticket(), self.xd_ticket()},
        )

    def get_plant_state_input_port(self) -> InputPort:
        """Takes the plant's state."""
        return self._plant_state_port

    def get_state_output_port(self) -> OutputPort:
        """Gives the state in the world."""
        return self._state_port

    def away(self, context: Context) -> Array:
        """Returns how far the trunk has been moved back (3; m)."""
        return np.array(context.get_discrete_state(self._away).value())

    def set_away(self, context: Context, away: Array) -> None:
        """Sets how far the trunk has been moved back (3; m), in a context to be changed."""
        context.SetDiscreteState(self._away, away)

    def _calc_state(self, context: Context, output: BasicVector) -> None:
        state = np.array(self._plant_state_port.Eval(context))
        state[quadruped.POSITION] += context.get_discrete_state(self._away).value()
        output.SetFromVector(state)
