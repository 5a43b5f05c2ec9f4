"""Holds the action between two control steps."""

import numpy as np
from pydrake.systems.framework import Context, InputPort, LeafSystem, OutputPort, State

from glassgait.models.robots import quadruped
from glassgait.models.task import CONTROL_PERIOD


class ActionHold(LeafSystem):
    """Latches the action every 20 ms and remembers the one before.

    It latches in an unrestricted update, before the plant's discrete update of the same instant:
    an action acts at once. Drake's `ZeroOrderHold` latches in a discrete update, a plant step late.

    .. pydrake_system::

        name: ActionHold
        input_ports:
        - action
        output_ports:
        - held_action
        - previous_action

    Inputs: action (12).
    Outputs: held_action (12), the latest; previous_action (12), the one before it.
    State: both, latched every 20 ms (unrestricted update); zero at first. Feedthrough: none.
    """

    def __init__(self) -> None:
        super().__init__()
        n = quadruped.N_JOINTS
        self._actions = self.DeclareDiscreteState(2 * n)
        self._action_port = self.DeclareVectorInputPort("action", n)
        self._held_action_port = self.DeclareVectorOutputPort(
            name="held_action",
            size=n,
            calc=lambda context, output: output.SetFromVector(self._stored(context)[:n]),
            prerequisites_of_calc={self.xd_ticket()},
        )
        self._previous_action_port = self.DeclareVectorOutputPort(
            name="previous_action",
            size=n,
            calc=lambda context, output: output.SetFromVector(self._stored(context)[n:]),
            prerequisites_of_calc={self.xd_ticket()},
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period_sec=CONTROL_PERIOD, offset_sec=0.0, update=self._latch
        )

    def get_action_input_port(self) -> InputPort:
        """Takes the action to hold."""
        return self._action_port

    def get_held_action_output_port(self) -> OutputPort:
        """Gives the latest action."""
        return self._held_action_port

    def get_previous_action_output_port(self) -> OutputPort:
        """Gives the action before the latest."""
        return self._previous_action_port

    def _stored(self, context: Context) -> np.ndarray:
        return context.get_discrete_state(self._actions).value()

    def _latch(self, context: Context, state: State) -> None:
        held = self._stored(context)[: quadruped.N_JOINTS]
        latest = np.concatenate([self._action_port.Eval(context), held])
        state.get_mutable_discrete_state(self._actions).SetFromVector(latest)
