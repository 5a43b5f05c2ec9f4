"""Reads the feet's contacts by sensors that now and then are wrong."""

from pydrake.systems.framework import BasicVector, Context, InputPort, LeafSystem, OutputPort

from glassgait.models.robots import quadruped
from glassgait.models.task.contact import flip_contacts


class ContactNoise(LeafSystem):
    """Flips contacts at random.

    .. pydrake_system::

        name: ContactNoise
        input_ports:
        - foot_contact
        - uniform_noise
        output_ports:
        - sensed_contact

    Inputs: foot_contact (4, {0, 1}), FL FR RL RR. uniform_noise (4, in [0, 1]).
    Outputs: sensed_contact (4, {0, 1}), the opposite where the noise is below the share of wrong
    readings. State: none. Feedthrough: both inputs.
    """

    def __init__(self, flip_share: float) -> None:
        """
        Args:
            flip_share: Share of the readings that are wrong.

        Raises:
            ValueError: if the share is below 0 or above 1.
        """
        super().__init__()
        if not 0.0 <= flip_share <= 1.0:
            raise ValueError(f"contact noise: flip_share is {flip_share}; it must be from 0 to 1")
        self._flip_share = flip_share
        self._foot_contact_port = self.DeclareVectorInputPort("foot_contact", quadruped.N_LEGS)
        self._uniform_noise_port = self.DeclareVectorInputPort("uniform_noise", quadruped.N_LEGS)
        self._sensed_contact_port = self.DeclareVectorOutputPort(
            name="sensed_contact",
            size=quadruped.N_LEGS,
            calc=self._calc_sensed_contact,
            prerequisites_of_calc={self.all_input_ports_ticket()},
        )

    def get_foot_contact_input_port(self) -> InputPort:
        """Takes which feet touch."""
        return self._foot_contact_port

    def get_uniform_noise_input_port(self) -> InputPort:
        """Takes the noise."""
        return self._uniform_noise_port

    def get_sensed_contact_output_port(self) -> OutputPort:
        """Returns which feet seem to touch."""
        return self._sensed_contact_port

    def _calc_sensed_contact(self, context: Context, output: BasicVector) -> None:
        contact = self._foot_contact_port.Eval(context) > 0.5
        uniform = self._uniform_noise_port.Eval(context)
        output.SetFromVector(flip_contacts(contact, uniform, self._flip_share).astype(float))
