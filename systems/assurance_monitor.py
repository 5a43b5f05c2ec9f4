"""Decides at every control step whether the student may act."""

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    BasicVector,
    Context,
    InputPort,
    InputPortIndex,
    LeafSystem,
    OutputPort,
    State,
)

from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.assurance import (
    Hysteresis,
    MonitorState,
    Region,
    initial_monitor,
    step_monitor,
)


class AssuranceMonitor(LeafSystem):
    """Calls the expert while the observation is outside of the student's region.

    Its first output selects an input of Drake's `PortSwitch`, which evaluates only the policy that
    acts.

    .. pydrake_system::

        name: AssuranceMonitor
        input_ports:
        - observation
        output_ports:
        - port_selector
        - expert_acts
        - overrun

    Inputs: observation (47 + n_states), in the order of the region's names.
    Outputs: port_selector (abstract, InputPortIndex), the expert's port or the student's, and
    expert_acts (1, {0, 1}), after this instant's observation. overrun (1), widths of the range that
    the observation is farthest outside of; a student's disagreement counts as one, if watched.
    State: the monitor's state after the previous control step, latched every 20 ms (unrestricted
    update). Feedthrough: observation to all outputs.
    """

    def __init__(
        self,
        region: Region,
        hysteresis: Hysteresis,
        expert_port: InputPortIndex,
        student_port: InputPortIndex,
    ) -> None:
        """
        Args:
            region: Where the student may act.
            hysteresis: When to call the expert, and when to let it go.
            expert_port: The expert's input of the switch.
            student_port: The student's input of the switch.
        """
        super().__init__()
        self._region = region
        self._hysteresis = hysteresis
        self._expert_port = expert_port
        self._student_port = student_port
        self._memory = self.DeclareDiscreteState(np.array(initial_monitor(()), dtype=float))
        self._observation_port = self.DeclareVectorInputPort("observation", len(region.names))
        observed = {self.all_input_ports_ticket()}
        self._port_selector_port = self.DeclareAbstractOutputPort(
            name="port_selector",
            alloc=lambda: AbstractValue.Make(InputPortIndex(0)),
            calc=self._calc_port_selector,
            prerequisites_of_calc=observed | {self.xd_ticket()},
        )
        self._expert_acts_port = self.DeclareVectorOutputPort(
            name="expert_acts",
            size=1,
            calc=self._calc_expert_acts,
            prerequisites_of_calc=observed | {self.xd_ticket()},
        )
        self._overrun_port = self.DeclareVectorOutputPort(
            name="overrun", size=1, calc=self._calc_overrun, prerequisites_of_calc=observed
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period_sec=CONTROL_PERIOD, offset_sec=0.0, update=self._latch
        )

    def get_observation_input_port(self) -> InputPort:
        """Takes the observation."""
        return self._observation_port

    def get_port_selector_output_port(self) -> OutputPort:
        """Gives the switch's input that acts."""
        return self._port_selector_port

    def get_expert_acts_output_port(self) -> OutputPort:
        """Gives whether the expert acts."""
        return self._expert_acts_port

    def get_overrun_output_port(self) -> OutputPort:
        """Gives how far outside of the region the observation is."""
        return self._overrun_port

    def _step(self, context: Context) -> MonitorState:
        expert_acts, calm_steps = context.get_discrete_state(self._memory).value()
        stored = MonitorState(np.array(expert_acts > 0.5), np.array(calm_steps, dtype=np.int64))
        return step_monitor(stored, self._overrun_port.Eval(context)[0], self._hysteresis)

    def _calc_overrun(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([self._region.overrun(self._observation_port.Eval(context))])

    def _calc_expert_acts(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([float(self._step(context).expert_acts)])

    def _calc_port_selector(self, context: Context, output: AbstractValue) -> None:
        acts = self._expert_acts_port.Eval(context)[0] > 0.5
        output.set_value(self._expert_port if acts else self._student_port)

    def _latch(self, context: Context, state: State) -> None:
        after = np.array(self._step(context), dtype=float)
        state.get_mutable_discrete_state(self._memory).SetFromVector(after)
