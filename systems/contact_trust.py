"""Believes contact sensors that change, and takes the feet's heights for those that do not."""

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import (
    BasicVector,
    Context,
    InputPort,
    LeafSystem,
    OutputPort,
    State,
)

from glassgait.models.arrays import Array
from glassgait.models.estimation.contact import ContactTrust
from glassgait.models.robots import quadruped
from glassgait.models.task import CONTROL_PERIOD
from glassgait.systems.cached_value import CachedValue


class ContactTrustSystem(LeafSystem):
    """Returns which feet touch, whatever a contact sensor reads that is stuck.

    A sensor that has not changed for a second is not believed; its foot then touches where it is
    low. See `ContactTrust`.

    .. pydrake_system::

        name: ContactTrustSystem
        input_ports:
        - touching
        - foot_height
        output_ports:
        - believed_contact
        - believed_touching

    Inputs: touching (4, {0, 1}), FL FR RL RR, what the sensors read at this instant. foot_height
    (4, m), estimated before it is known which feet touch.
    Outputs: believed_contact (4, {0, 1}), what the sensors read now or at the previous control
    step, and believed_touching (4, {0, 1}), what they read now, but for sensors that are not
    believed.
    State: what the sensors read, then for how many control steps they have not changed (8),
    latched every 20 ms (unrestricted update).
    Feedthrough: both inputs to both outputs.
    """

    def __init__(self) -> None:
        super().__init__()
        self._memory = self.DeclareDiscreteState(np.concatenate(ContactTrust.begin()).astype(float))
        n_legs = quadruped.N_LEGS
        self._touching_port = self.DeclareVectorInputPort("touching", n_legs)
        self._foot_height_port = self.DeclareVectorInputPort("foot_height", n_legs)
        # Both outputs and the update come from one look at the sensors.
        self._trust = CachedValue(
            self,
            "contact trust",
            self._calc_trust,
            {self._touching_port.ticket(), self.xd_ticket()},
        )
        both = {
            self._trust.ticket(),
            self._touching_port.ticket(),
            self._foot_height_port.ticket(),
        }
        self._believed_contact_port = self.DeclareVectorOutputPort(
            name="believed_contact",
            size=n_legs,
            calc=self._calc_believed_contact,
            prerequisites_of_calc={*both, self.xd_ticket()},
        )
        self._believed_touching_port = self.DeclareVectorOutputPort(
            name="believed_touching",
            size=n_legs,
            calc=self._calc_believed_touching,
            prerequisites_of_calc=both,
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period_sec=CONTROL_PERIOD, offset_sec=0.0, update=self._latch
        )

    def get_touching_input_port(self) -> InputPort:
        """Takes which feet seem to touch at this instant."""
        return self._touching_port

    def get_foot_height_input_port(self) -> InputPort:
        """Takes how high the feet are."""
        return self._foot_height_port

    def get_believed_contact_output_port(self) -> OutputPort:
        """Returns which feet touch, or did a control step ago."""
        return self._believed_contact_port

    def get_believed_touching_output_port(self) -> OutputPort:
        """Returns which feet touch at this instant."""
        return self._believed_touching_port

    def _before(self, context: Context) -> ContactTrust:
        memory = context.get_discrete_state(self._memory).value().astype(np.int64)
        reading, unchanged = np.split(memory, 2)
        return ContactTrust(reading.astype(np.int8), unchanged)

    def _reading(self, context: Context) -> NDArray[np.bool_]:
        return self._touching_port.Eval(context) > 0.5

    def _calc_trust(self, context: Context) -> ContactTrust:
        return self._before(context).after(self._reading(context))

    def _believed(self, context: Context, contact: NDArray[np.bool_]) -> Array:
        height = self._foot_height_port.Eval(context)
        return self._trust.Eval(context).believed(contact, height).astype(float)

    def _calc_believed_contact(self, context: Context, output: BasicVector) -> None:
        lasting = self._before(context).lasting(self._reading(context))
        output.SetFromVector(self._believed(context, lasting))

    def _calc_believed_touching(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._believed(context, self._reading(context)))

    def _latch(self, context: Context, state: State) -> None:
        memory = np.concatenate(self._trust.Eval(context)).astype(float)
        state.get_mutable_discrete_state(self._memory).SetFromVector(memory)
