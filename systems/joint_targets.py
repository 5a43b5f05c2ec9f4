"""Turns actions into what the joints' PD control is to follow."""

from collections.abc import Sequence

import numpy as np
from pydrake.systems.framework import BasicVector, Context, InputPort, LeafSystem, OutputPort

from glassgait.models.a1 import robot


class JointTargets(LeafSystem):
    """Maps an action to the plant's desired state.

    .. pydrake_system::

        name: JointTargets
        input_ports:
        - action
        output_ports:
        - desired_state

    Inputs: action (12), in the order of `robot.JOINTS`.
    Outputs: desired_state (24; rad, rad/s), target positions, then zero velocities, in the order of
    the plant's actuators. State: none. Feedthrough: yes.
    """

    def __init__(self, actuated_joints: Sequence[str]) -> None:
        """
        Args:
            actuated_joints: Names of the joints in the order of the plant's actuators.

        Raises:
            ValueError: if the names are not those of `robot.JOINTS`.
        """
        super().__init__()
        if sorted(actuated_joints) != sorted(robot.JOINTS):
            raise ValueError(f"joint targets: {list(actuated_joints)} are not the robot's joints")
        self._order = [robot.JOINTS.index(name) for name in actuated_joints]
        self._action_port = self.DeclareVectorInputPort("action", robot.N_JOINTS)
        self._desired_state_port = self.DeclareVectorOutputPort(
            name="desired_state",
            size=2 * robot.N_JOINTS,
            calc=self._calc_desired_state,
            prerequisites_of_calc={self.all_input_ports_ticket()},
        )

    def get_action_input_port(self) -> InputPort:
        """Takes the action."""
        return self._action_port

    def get_desired_state_output_port(self) -> OutputPort:
        """Gives the joints' desired state."""
        return self._desired_state_port

    def _calc_desired_state(self, context: Context, output: BasicVector) -> None:
        targets = robot.joint_targets(self._action_port.Eval(context))[self._order]
        output.SetFromVector(np.concatenate([targets, np.zeros_like(targets)]))
