"""Watches for falls and other failures."""

from pydrake.systems.framework import BasicVector, Context, InputPort, LeafSystem, OutputPort

from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task.ground import LEVEL_GROUND, Ground
from glassgait.models.task.termination import FAILURES, TerminationLimits, failures


class FallMonitor(LeafSystem):
    """Finds which failures the robot shows.

    .. pydrake_system::

        name: FallMonitor
        input_ports:
        - state
        - action
        - previous_action
        output_ports:
        - failures

    Inputs: state (37), the plant's. action (12), held during the last control step.
    previous_action (12).
    Outputs: failures (7, {0, 1}), in the order of `FAILURES`.
    State: none. Feedthrough: all inputs.

    Attributes:
        robot: The robot.
        ground: What it stands on.
    """

    def __init__(
        self,
        robot: Robot,
        limits: TerminationLimits | None = None,
        ground: Ground = LEVEL_GROUND,
    ) -> None:
        super().__init__()
        self.robot, self.ground = robot, ground
        self._limits = limits or TerminationLimits()
        declare = self.DeclareVectorInputPort
        self._state_port = declare("state", quadruped.N_POSITIONS + quadruped.N_VELOCITIES)
        self._action_port = declare("action", quadruped.N_JOINTS)
        self._previous_action_port = declare("previous_action", quadruped.N_JOINTS)
        self._failures_port = self.DeclareVectorOutputPort(
            name="failures",
            size=len(FAILURES),
            calc=self._calc_failures,
            prerequisites_of_calc={self.all_input_ports_ticket()},
        )

    def get_state_input_port(self) -> InputPort:
        """Takes the plant's state."""
        return self._state_port

    def get_action_input_port(self) -> InputPort:
        """Takes the action held during the last step."""
        return self._action_port

    def get_previous_action_input_port(self) -> InputPort:
        """Takes the action of the step before."""
        return self._previous_action_port

    def get_failures_output_port(self) -> OutputPort:
        """Gives a flag for each failure."""
        return self._failures_port

    def _calc_failures(self, context: Context, output: BasicVector) -> None:
        shown = failures(
            self.robot,
            self._state_port.Eval(context),
            action=self._action_port.Eval(context),
            previous_action=self._previous_action_port.Eval(context),
            limits=self._limits,
            ground=self.ground,
        )
        output.SetFromVector(shown.astype(float))
