"""Measures the forces at the feet."""

from collections.abc import Mapping

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.geometry import GeometryId
from pydrake.multibody.plant import ContactResults
from pydrake.systems.framework import BasicVector, Context, InputPort, LeafSystem, OutputPort

from glassgait.models.robots import quadruped


class FootForceSensor(LeafSystem):
    """Measures how hard each foot presses.

    .. pydrake_system::

        name: FootForceSensor
        input_ports:
        - contact_results
        output_ports:
        - foot_force

    Inputs: contact_results (ContactResults), the plant's, of point contacts.
    Outputs: foot_force (4, N), FL FR RL RR, the normal forces at each foot, summed.
    State: none. Feedthrough: yes.
    """

    def __init__(self, feet: Mapping[GeometryId, int]) -> None:
        """
        Args:
            feet: The number of the leg, FL FR RL RR, of each foot's collision geometry.
        """
        super().__init__()
        self._feet = dict(feet)
        self._contact_results_port = self.DeclareAbstractInputPort(
            "contact_results", AbstractValue.Make(ContactResults())
        )
        self._foot_force_port = self.DeclareVectorOutputPort(
            name="foot_force",
            size=quadruped.N_LEGS,
            calc=self._calc_foot_force,
            prerequisites_of_calc={self.all_input_ports_ticket()},
        )

    def get_contact_results_input_port(self) -> InputPort:
        """Takes the plant's contacts."""
        return self._contact_results_port

    def get_foot_force_output_port(self) -> OutputPort:
        """Returns how hard each foot presses."""
        return self._foot_force_port

    def _calc_foot_force(self, context: Context, output: BasicVector) -> None:
        results = self._contact_results_port.Eval(context)
        assert isinstance(results, ContactResults)
        force = np.zeros(quadruped.N_LEGS)
        for index in range(results.num_point_pair_contacts()):
            contact = results.point_pair_contact_info(index)
            pair = contact.point_pair()
            for geometry in (pair.id_A, pair.id_B):
                if geometry in self._feet:
                    force[self._feet[geometry]] += abs(contact.contact_force() @ pair.nhat_BA_W)
        output.SetFromVector(force)
