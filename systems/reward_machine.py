"""Tracks where in the gait the robot is."""

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    InputPort,
    LeafSystem,
    OutputPort,
    State,
)

from glassgait.models.robots import quadruped
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait
from glassgait.models.task.reward_machine import MachineState, MachineStep, RewardMachine
from glassgait.systems.cached_value import CachedValue


class RewardMachineSystem(LeafSystem):
    """Steps the gait's reward machine, a Mealy machine, at the control rate.

    .. pydrake_system::

        name: RewardMachineSystem
        input_ports:
        - foot_contact
        - foot_height
        - commanded_dwell
        output_ports:
        - rm_state
        - rm_iterations
        - reward_multiplier
        - served_dwell

    Inputs: foot_contact (4, {0, 1}), FL FR RL RR. foot_height (4, m), above the ground.
    commanded_dwell (1, control steps).
    Outputs: rm_state (n_states, one-hot) and rm_iterations (1, control steps), after this instant's
    propositions. reward_multiplier (1), the factor on this step's plain reward. served_dwell (1,
    control steps), the share of commanded_dwell that the transition of this instant stands for, 0
    where none fired.
    State: machine state, iterations and age after the previous control step, latched every 20 ms
    (unrestricted update). Feedthrough: all inputs to all outputs.
    """

    def __init__(self, gait: Gait) -> None:
        super().__init__()
        self._machine = RewardMachine(gait)
        self._machine_state = self.DeclareDiscreteState(np.ravel(self._machine.initial()))
        self._foot_contact_port = self.DeclareVectorInputPort("foot_contact", quadruped.N_LEGS)
        self._foot_height_port = self.DeclareVectorInputPort("foot_height", quadruped.N_LEGS)
        self._commanded_dwell_port = self.DeclareVectorInputPort("commanded_dwell", 1)
        # Four outputs and the update are of one step; the machine takes it once.
        self._step = CachedValue(
            self, "machine step", self._calc_step, {self.all_input_ports_ticket(), self.xd_ticket()}
        )
        of_step = {self._step.ticket()}
        self._rm_state_port = self.DeclareVectorOutputPort(
            name="rm_state",
            size=gait.n_states,
            calc=self._calc_rm_state,
            prerequisites_of_calc=of_step,
        )
        self._rm_iterations_port = self.DeclareVectorOutputPort(
            name="rm_iterations",
            size=1,
            calc=self._calc_rm_iterations,
            prerequisites_of_calc=of_step,
        )
        self._reward_multiplier_port = self.DeclareVectorOutputPort(
            name="reward_multiplier",
            size=1,
            calc=self._calc_reward_multiplier,
            prerequisites_of_calc=of_step,
        )
        self._served_dwell_port = self.DeclareVectorOutputPort(
            name="served_dwell",
            size=1,
            calc=self._calc_served_dwell,
            prerequisites_of_calc=of_step,
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period_sec=CONTROL_PERIOD, offset_sec=0.0, update=self._latch
        )

    def get_foot_contact_input_port(self) -> InputPort:
        """Takes which feet touch."""
        return self._foot_contact_port

    def get_foot_height_input_port(self) -> InputPort:
        """Takes how high the feet are."""
        return self._foot_height_port

    def get_commanded_dwell_input_port(self) -> InputPort:
        """Takes the commanded iterations in a state."""
        return self._commanded_dwell_port

    def get_rm_state_output_port(self) -> OutputPort:
        """Gives the machine's state, one-hot."""
        return self._rm_state_port

    def get_rm_iterations_output_port(self) -> OutputPort:
        """Gives the control steps spent in that state."""
        return self._rm_iterations_port

    def get_reward_multiplier_output_port(self) -> OutputPort:
        """Gives the factor on the plain reward."""
        return self._reward_multiplier_port

    def get_served_dwell_output_port(self) -> OutputPort:
        """Gives the rhythm that this instant's transition served."""
        return self._served_dwell_port

    def _before(self, context: Context) -> MachineState:
        stored = context.get_discrete_state(self._machine_state).value().astype(np.int64)
        return MachineState(*stored)

    def _calc_step(self, context: Context) -> MachineStep:
        return self._machine.step(
            self._before(context),
            foot_contact=self._foot_contact_port.Eval(context) > 0.5,
            foot_height=self._foot_height_port.Eval(context),
            commanded_dwell=self._commanded_dwell_port.Eval(context)[0],
        )

    def _calc_rm_state(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._machine.one_hot(self._step.Eval(context).machine.state))

    def _calc_rm_iterations(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([float(self._step.Eval(context).machine.iterations)])

    def _calc_reward_multiplier(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([float(self._step.Eval(context).multiplier)])

    def _calc_served_dwell(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([float(self._step.Eval(context).served_dwell)])

    def _latch(self, context: Context, state: State) -> None:
        after = np.ravel(self._step.Eval(context).machine).astype(float)
        state.get_mutable_discrete_state(self._machine_state).SetFromVector(after)
