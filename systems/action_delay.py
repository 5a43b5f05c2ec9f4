"""Brings actions to the joints late."""

import math

import numpy as np
from pydrake.systems.framework import Context, InputPort, LeafSystem, OutputPort, State

from glassgait.models.robots import quadruped
from glassgait.models.task import CONTROL_PERIOD

MOST_LATENCY = 2 * CONTROL_PERIOD
"""Greatest time from a control instant until its action is passed on (s)."""


class ActionDelay(LeafSystem):
    """Passes on what the action hold holds, some time after it came.

    A robot's computer and its bus take time: what it decides at a control instant reaches the
    joints up to two control periods later.

    .. pydrake_system::

        name: ActionDelay
        input_ports:
        - held_action
        output_ports:
        - delayed_action

    Inputs: held_action (12), as the action hold gives it.
    Outputs: delayed_action (12), what was held `latency` seconds ago; zero at first.
    State: that action, and where the latency is above 20 ms the one after it, both latched once in
    20 ms, `latency` after a control instant (unrestricted update, every `time_step`). Feedthrough:
    none.
    """

    def __init__(self, latency: float, time_step: float = 0.0) -> None:
        """
        Args:
            latency: Time from a control instant until its action is passed on (s), above 0 and up
                to two control periods.
            time_step: The plant's period (s), of which the latency is a multiple; 0 for a
                continuous plant.

        Raises:
            ValueError: if the latency is out of range, or no multiple of the time step.
        """
        super().__init__()
        if not 0.0 < latency <= MOST_LATENCY:
            raise ValueError(
                f"action delay: latency is {latency}; it must be above 0 and up to {MOST_LATENCY}"
            )
        # Updates at the plant's own instants: those of a period and an offset of their own would
        # differ from them by rounding errors, and come before or after the plant's at random.
        self._step = time_step or latency
        steps, self._n_steps = latency / self._step, CONTROL_PERIOD / self._step
        if abs(round(steps) - steps) > 1e-9:
            raise ValueError(
                f"action delay: latency is {latency}; it must be a multiple of {time_step}"
            )
        self._phase = round(steps)
        # Within a period an action may pass on; else it waits until the next one has come.
        waiting = math.ceil(latency / CONTROL_PERIOD - 1e-9) - 1
        self._action = self.DeclareDiscreteState(quadruped.N_JOINTS)
        self._waiting = self.DeclareDiscreteState(waiting * quadruped.N_JOINTS)
        self._held_action_port = self.DeclareVectorInputPort("held_action", quadruped.N_JOINTS)
        self._delayed_action_port = self.DeclareStateOutputPort("delayed_action", self._action)
        if time_step:
            self.DeclarePeriodicUnrestrictedUpdateEvent(
                period_sec=time_step, offset_sec=0.0, update=self._latch_in_phase
            )
        else:
            self.DeclarePeriodicUnrestrictedUpdateEvent(
                period_sec=CONTROL_PERIOD,
                offset_sec=latency % CONTROL_PERIOD,
                update=self._latch,
            )

    def get_held_action_input_port(self) -> InputPort:
        """Takes the action that is held."""
        return self._held_action_port

    def get_delayed_action_output_port(self) -> OutputPort:
        """Gives the action that was held then."""
        return self._delayed_action_port

    def _latch_in_phase(self, context: Context, state: State) -> None:
        step = round(context.get_time() / self._step)
        if (step - self._phase) % round(self._n_steps) == 0:
            self._latch(context, state)

    def _latch(self, context: Context, state: State) -> None:
        waiting = context.get_discrete_state(self._waiting).value()
        line = np.concatenate([waiting, self._held_action_port.Eval(context)])
        passed, waiting = np.split(line, [quadruped.N_JOINTS])
        state.get_mutable_discrete_state(self._action).SetFromVector(passed)
        state.get_mutable_discrete_state(self._waiting).SetFromVector(waiting)
