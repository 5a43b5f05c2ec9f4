"""Measures base velocity and foot heights exactly, as only a simulation can."""

from pydrake.systems.framework import BasicVector, Context, InputPort, LeafSystem, OutputPort

from glassgait.models.a1 import robot
from glassgait.models.task.observation import N_ESTIMATED, body_state


class BodyStateSensor(LeafSystem):
    """Stands in for the state estimator with the true values.

    .. pydrake_system::

        name: BodyStateSensor
        input_ports:
        - state
        output_ports:
        - body_state

    Inputs: state (37), the plant's.
    Outputs: body_state (7), base linear velocity scaled by 2 (m/s, trunk frame) and foot heights
    (m, world frame). State: none. Feedthrough: yes.
    """

    def __init__(self) -> None:
        super().__init__()
        self._state_port = self.DeclareVectorInputPort(
            name="state", size=robot.N_POSITIONS + robot.N_VELOCITIES
        )
        self._body_state_port = self.DeclareVectorOutputPort(
            name="body_state",
            size=N_ESTIMATED,
            calc=self._calc_body_state,
            prerequisites_of_calc={self.all_input_ports_ticket()},
        )

    def get_state_input_port(self) -> InputPort:
        """Takes the plant's state."""
        return self._state_port

    def get_body_state_output_port(self) -> OutputPort:
        """Gives the true body state."""
        return self._body_state_port

    def _calc_body_state(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(body_state(self._state_port.Eval(context)))
