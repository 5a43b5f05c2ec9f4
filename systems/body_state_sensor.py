"""Measures base velocity and foot heights exactly, as only a simulation can."""

from functools import partial

from pydrake.systems.framework import InputPort, OutputPort

from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task.ground import LEVEL_GROUND, Ground
from glassgait.models.task.observation import N_ESTIMATED, body_state
from glassgait.systems.function import FunctionSystem


class BodyStateSensor(FunctionSystem):
    """Stands in for the state estimator with the true values.

    .. pydrake_system::

        name: BodyStateSensor
        input_ports:
        - state
        output_ports:
        - body_state

    Inputs: state (37), the plant's.
    Outputs: body_state (7), base linear velocity scaled by 2 (m/s, trunk frame) and foot heights
    (m) above the ground. State: none. Feedthrough: yes. Converts to AutoDiffXd.
    """

    def __init__(self, robot: Robot, ground: Ground = LEVEL_GROUND) -> None:
        super().__init__(
            inputs={"state": quadruped.N_POSITIONS + quadruped.N_VELOCITIES},
            output=("body_state", N_ESTIMATED),
            function=partial(body_state, robot, ground=ground),
        )

    def get_state_input_port(self) -> InputPort:
        """Takes the plant's state."""
        return self.GetInputPort("state")

    def get_body_state_output_port(self) -> OutputPort:
        """Gives the true body state."""
        return self.GetOutputPort("body_state")
