"""Estimates base velocity and foot heights."""

from collections.abc import Callable

from pydrake.systems.framework import (
    BasicVector,
    Context,
    InputPort,
    LeafSystem,
    OutputPort,
    State,
)

from glassgait.models.arrays import Array
from glassgait.models.robots import quadruped
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.observation import N_ESTIMATED


class StateEstimator(LeafSystem):
    """Estimates the body state from what the robot measures or knows.

    .. pydrake_system::

        name: StateEstimator
        input_ports:
        - proprioception
        output_ports:
        - body_state
        - previous_foot_height

    Inputs: proprioception (40 + n_states), in the order of `ObservationLayout`.
    Outputs: body_state (7), base linear velocity scaled by 2 (m/s, trunk frame) and foot heights
    (m, world frame). previous_foot_height (4, m), those heights at the control instant before; zero
    at first. A reward machine that reads them closes no loop with an estimator that sees its state.
    State: the foot heights, latched every 20 ms (unrestricted update). Feedthrough: proprioception
    to body_state.
    """

    def __init__(self, estimator: Callable[[Array], Array], n_proprioceptive: int) -> None:
        """
        Args:
            estimator: Maps proprioception (40 + n_states) to the body state (7).
            n_proprioceptive: Length of the proprioception.

        Raises:
            ValueError: if that length is below 1.
        """
        super().__init__()
        if n_proprioceptive < 1:
            raise ValueError(
                f"state estimator: n_proprioceptive is {n_proprioceptive}; it must be 1 or more"
            )
        self._estimator = estimator
        self._proprioception_port = self.DeclareVectorInputPort("proprioception", n_proprioceptive)
        self._body_state_port = self.DeclareVectorOutputPort(
            name="body_state",
            size=N_ESTIMATED,
            calc=self._calc_body_state,
            prerequisites_of_calc={self.all_input_ports_ticket()},
        )

        self._foot_height = self.DeclareDiscreteState(quadruped.N_LEGS)
        self._previous_foot_height_port = self.DeclareStateOutputPort(
            "previous_foot_height", self._foot_height
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period_sec=CONTROL_PERIOD, offset_sec=0.0, update=self._latch
        )

    def get_proprioception_input_port(self) -> InputPort:
        """Takes the observation without the body state."""
        return self._proprioception_port

    def get_body_state_output_port(self) -> OutputPort:
        """Gives the estimate."""
        return self._body_state_port

    def get_previous_foot_height_output_port(self) -> OutputPort:
        """Gives the foot heights that were estimated at the control instant before."""
        return self._previous_foot_height_port

    def _calc_body_state(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._estimator(self._proprioception_port.Eval(context)))

    def _latch(self, context: Context, state: State) -> None:
        heights = self._body_state_port.Eval(context)[-quadruped.N_LEGS :]
        state.get_mutable_discrete_state(self._foot_height).SetFromVector(heights)
