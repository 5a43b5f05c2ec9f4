"""Reads the feet's contacts by sensors that now and then are wrong, or that are stuck."""

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, InputPort, LeafSystem, OutputPort

from glassgait.models.estimation.contact import read_contacts, stuck_sensors
from glassgait.models.robots import quadruped

SOUND_SENSORS = stuck_sensors((), ())
"""Sensors of which none is stuck (4)."""


class ContactSensor(LeafSystem):
    """Reads contacts, flips some at random, and always reads the same where it is stuck.

    .. pydrake_system::

        name: ContactSensor
        input_ports:
        - touching
        - uniform_noise
        output_ports:
        - sensed_contact

    Inputs: touching (4, {0, 1}), FL FR RL RR. uniform_noise (4, in [0, 1]), optional: without
    it no reading is flipped.
    Outputs: sensed_contact (4, {0, 1}), the opposite where the noise is below the share of wrong
    readings, and of a stuck sensor its constant. State: none. Feedthrough: both inputs.
    """

    def __init__(self, flip_share: float, stuck: NDArray[np.int8] = SOUND_SENSORS) -> None:
        """
        Args:
            flip_share: Share of the readings that are wrong.
            stuck: Which sensors are stuck (4), as `stuck_sensors` returns it.

        Raises:
            ValueError: if the share is below 0 or above 1.
        """
        super().__init__()
        if not 0.0 <= flip_share <= 1.0:
            raise ValueError(f"contact sensor: flip_share is {flip_share}; it must be from 0 to 1")
        self._flip_share, self._stuck = flip_share, stuck
        self._touching_port = self.DeclareVectorInputPort("touching", quadruped.N_LEGS)
        self._uniform_noise_port = self.DeclareVectorInputPort("uniform_noise", quadruped.N_LEGS)
        self._sensed_contact_port = self.DeclareVectorOutputPort(
            name="sensed_contact",
            size=quadruped.N_LEGS,
            calc=self._calc_sensed_contact,
            prerequisites_of_calc={self.all_input_ports_ticket()},
        )

    def get_touching_input_port(self) -> InputPort:
        """Takes which feet touch."""
        return self._touching_port

    def get_uniform_noise_input_port(self) -> InputPort:
        """Takes the noise."""
        return self._uniform_noise_port

    def get_sensed_contact_output_port(self) -> OutputPort:
        """Returns which feet seem to touch."""
        return self._sensed_contact_port

    def _calc_sensed_contact(self, context: Context, output: BasicVector) -> None:
        contact = self._touching_port.Eval(context) > 0.5
        wrong = np.zeros(quadruped.N_LEGS, dtype=bool)
        if self._uniform_noise_port.HasValue(context):
            wrong = self._uniform_noise_port.Eval(context) < self._flip_share
        output.SetFromVector(read_contacts(contact, wrong, self._stuck).astype(float))
