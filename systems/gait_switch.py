"""Tracks where in which of several gaits the robot is, and changes the gait on request."""

import numpy as np
from pydrake.systems.framework import Context, InputPort

from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.models.task.reward_machine import MachineStep
from glassgait.systems.reward_machine import RewardMachineSystem


class GaitSwitchSystem(RewardMachineSystem):
    """Steps the machine of several gaits, a Mealy machine, at the control rate.

    .. pydrake_system::

        name: GaitSwitchSystem
        input_ports:
        - foot_contact
        - foot_height
        - commanded_dwell
        - acted
        - requested_gait
        output_ports:
        - rm_state
        - rm_iterations
        - reward_multiplier
        - served_dwell

    Inputs: foot_contact (4, {0, 1}), FL FR RL RR. foot_height (4, m), above the ground.
    commanded_dwell (1, control steps). acted (1, {0, 1}), as `RewardMachineSystem` has it; may stay
    unconnected. requested_gait (1), the number of the gait that is to run;
    may stay unconnected, and then the gait that runs goes on.
    Outputs: rm_state (n_states of all gaits, one-hot) and rm_iterations (1, control steps), after
    this instant's propositions and change of gait. reward_multiplier (1) and served_dwell (1,
    control steps), of the gait that ran until now; see `RewardMachineSystem`.
    State: machine state, iterations and the gait's age after the previous control step, latched
    every 20 ms (unrestricted update). Feedthrough: all inputs to all outputs.
    Raises: ValueError where the requested gait has no such number.
    """

    def __init__(self, switch: GaitSwitch) -> None:
        super().__init__(switch.gait)
        self._switch = switch
        self._requested_gait_port = self.DeclareVectorInputPort("requested_gait", 1)

    def get_requested_gait_input_port(self) -> InputPort:
        """Takes the number of the gait that is to run."""
        return self._requested_gait_port

    def _calc_step(self, context: Context) -> MachineStep:
        machine = self._before(context)
        requested = self._switch.gait_of(machine.state)
        if self._requested_gait_port.HasValue(context):
            requested = np.rint(self._requested_gait_port.Eval(context)[0]).astype(np.int64)
        return self._switch.step(
            machine,
            requested=requested,
            foot_contact=self._foot_contact_port.Eval(context) > 0.5,
            foot_height=self._foot_height_port.Eval(context),
            commanded_dwell=self._commanded_dwell_port.Eval(context)[0],
        )
