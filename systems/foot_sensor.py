"""Senses the contacts and the heights of the feet."""

from pydrake.systems.framework import (
    BasicVector,
    Context,
    InputPort,
    LeafSystem,
    OutputPort,
    State,
)

from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.ground import LEVEL_GROUND, FootSense, Ground, sense_feet
from glassgait.systems.cached_value import CachedValue


class FootSensor(LeafSystem):
    """Senses which feet touch the ground and how high they are.

    .. pydrake_system::

        name: FootSensor
        input_ports:
        - state
        output_ports:
        - foot_contact
        - foot_height
        - touching

    Inputs: state (37), the plant's, as laid out in `glassgait.models.robots.quadruped`.
    Outputs: foot_contact (4, {0, 1}), FL FR RL RR, now or at the previous control step.
    foot_height (4, m), of each foot's lowest point above the ground, world frame. touching (4,
    {0, 1}), which feet press on the ground at this instant.
    State: contacts of the previous control step, latched every 20 ms (unrestricted update).
    Feedthrough: state to all outputs.
    """

    def __init__(self, robot: Robot, ground: Ground = LEVEL_GROUND) -> None:
        super().__init__()
        self._robot, self._ground = robot, ground
        self._touching = self.DeclareDiscreteState(quadruped.N_LEGS)
        self._state_port = self.DeclareVectorInputPort(
            name="state", size=quadruped.N_POSITIONS + quadruped.N_VELOCITIES
        )
        # All outputs and the update come from one look at the feet.
        self._sense = CachedValue(
            self, "foot sense", self._calc_sense, {self.all_input_ports_ticket(), self.xd_ticket()}
        )
        self._foot_contact_port = self.DeclareVectorOutputPort(
            name="foot_contact",
            size=quadruped.N_LEGS,
            calc=self._calc_foot_contact,
            prerequisites_of_calc={self._sense.ticket()},
        )
        self._foot_height_port = self.DeclareVectorOutputPort(
            name="foot_height",
            size=quadruped.N_LEGS,
            calc=self._calc_foot_height,
            prerequisites_of_calc={self._sense.ticket()},
        )
        self._touching_port = self.DeclareVectorOutputPort(
            name="touching",
            size=quadruped.N_LEGS,
            calc=self._calc_touching,
            prerequisites_of_calc={self._sense.ticket()},
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period_sec=CONTROL_PERIOD, offset_sec=0.0, update=self._latch
        )

    def get_state_input_port(self) -> InputPort:
        """Takes the plant's state."""
        return self._state_port

    def get_foot_contact_output_port(self) -> OutputPort:
        """Gives which feet touch."""
        return self._foot_contact_port

    def get_foot_height_output_port(self) -> OutputPort:
        """Gives how high the feet are."""
        return self._foot_height_port

    def get_touching_output_port(self) -> OutputPort:
        """Returns which feet touch at this instant."""
        return self._touching_port

    def _calc_sense(self, context: Context) -> FootSense:
        previously = context.get_discrete_state(self._touching).value() > 0.5
        return sense_feet(
            self._robot, self._state_port.Eval(context), previously, ground=self._ground
        )

    def _calc_foot_contact(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._sense.Eval(context).contact.astype(float))

    def _calc_foot_height(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._sense.Eval(context).height)

    def _calc_touching(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._sense.Eval(context).touching.astype(float))

    def _latch(self, context: Context, state: State) -> None:
        touching = self._sense.Eval(context).touching
        state.get_mutable_discrete_state(self._touching).SetFromVector(touching.astype(float))
