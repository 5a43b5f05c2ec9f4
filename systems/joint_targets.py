"""Turns actions into what the joints' PD control is to follow."""

from collections.abc import Sequence

import numpy as np
from pydrake.systems.framework import InputPort, OutputPort

from glassgait.models.arrays import Array
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.systems.function import FunctionSystem


class JointTargets(FunctionSystem):
    """Maps an action to the plant's desired state.

    .. pydrake_system::

        name: JointTargets
        input_ports:
        - action
        output_ports:
        - desired_state

    Inputs: action (12), in the order of `quadruped.JOINTS`.
    Outputs: desired_state (24; rad, rad/s), target positions, then zero velocities, in the order of
    the plant's actuators. State: none. Feedthrough: yes. Converts to AutoDiffXd.
    """

    def __init__(
        self, robot: Robot, actuated_joints: Sequence[str], *, limited: bool = False
    ) -> None:
        """
        Args:
            robot: The robot.
            actuated_joints: Names of the joints in the order of the plant's actuators.
            limited: Whether targets are kept within the joints' ranges.

        Raises:
            ValueError: if the names are not those of `quadruped.JOINTS`.
        """
        if sorted(actuated_joints) != sorted(quadruped.JOINTS):
            raise ValueError(f"joint targets: {list(actuated_joints)} are not the robot's joints")
        order = [quadruped.JOINTS.index(name) for name in actuated_joints]

        def desired_state(action: Array) -> Array:
            targets = robot.joint_targets(action, limited=limited)[order]
            return np.concatenate([targets, 0.0 * targets])

        super().__init__(
            inputs={"action": quadruped.N_JOINTS},
            output=("desired_state", 2 * quadruped.N_JOINTS),
            function=desired_state,
        )

    def get_action_input_port(self) -> InputPort:
        """Takes the action."""
        return self.GetInputPort("action")

    def get_desired_state_output_port(self) -> OutputPort:
        """Gives the joints' desired state."""
        return self.GetOutputPort("desired_state")
