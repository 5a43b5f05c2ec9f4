"""Remembers which feet touched at the control step before."""

from pydrake.systems.framework import (
    BasicVector,
    Context,
    InputPort,
    LeafSystem,
    OutputPort,
    State,
)

from glassgait.models.robots import quadruped
from glassgait.models.task import CONTROL_PERIOD


class ContactMemory(LeafSystem):
    """Remembers which feet touch now or did at the control step before, as `FootSensor` does.

    It reads sensors that report the contacts of this instant alone.

    .. pydrake_system::

        name: ContactMemory
        input_ports:
        - touching
        output_ports:
        - foot_contact

    Inputs: touching (4, {0, 1}), FL FR RL RR, at this instant.
    Outputs: foot_contact (4, {0, 1}), now or at the previous control step.
    State: contacts of the previous control step, latched every 20 ms (unrestricted update).
    Feedthrough: yes.
    """

    def __init__(self) -> None:
        super().__init__()
        self._touched = self.DeclareDiscreteState(quadruped.N_LEGS)
        self._touching_port = self.DeclareVectorInputPort("touching", quadruped.N_LEGS)
        self._foot_contact_port = self.DeclareVectorOutputPort(
            name="foot_contact",
            size=quadruped.N_LEGS,
            calc=self._calc_foot_contact,
            prerequisites_of_calc={self.all_input_ports_ticket(), self.xd_ticket()},
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period_sec=CONTROL_PERIOD, offset_sec=0.0, update=self._latch
        )

    def get_touching_input_port(self) -> InputPort:
        """Takes which feet touch at this instant."""
        return self._touching_port

    def get_foot_contact_output_port(self) -> OutputPort:
        """Returns which feet touch, or did a step ago."""
        return self._foot_contact_port

    def _calc_foot_contact(self, context: Context, output: BasicVector) -> None:
        touched = context.get_discrete_state(self._touched).value() > 0.5
        touching = self._touching_port.Eval(context) > 0.5
        output.SetFromVector((touching | touched).astype(float))

    def _latch(self, context: Context, state: State) -> None:
        touching = self._touching_port.Eval(context)
        state.get_mutable_discrete_state(self._touched).SetFromVector(touching)
