"""Decides at every control step whether the expert or the student acts."""

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, InputPortIndex, LeafSystem, OutputPort

from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.alternation import expert_acts


class AlternationSchedule(LeafSystem):
    """Lets the expert act every n-th control step (paper, Algorithm 1).

    Its output selects an input of Drake's `PortSwitch`, which evaluates only the policy that acts.

    .. pydrake_system::

        name: AlternationSchedule
        output_ports:
        - port_selector

    Outputs: port_selector (abstract, InputPortIndex), the expert's port or the student's.
    State: none; a function of time. Feedthrough: none.
    """

    def __init__(
        self, period: int, expert_port: InputPortIndex, student_port: InputPortIndex
    ) -> None:
        """
        Args:
            period: Control steps from one action of the expert to the next: 1 is the expert alone,
                n is the ratio 1/n, 0 is the student alone.
            expert_port: The expert's input of the switch.
            student_port: The student's input of the switch.

        Raises:
            ValueError: if the period is negative.
        """
        super().__init__()
        if period < 0:
            raise ValueError(f"alternation: period is {period}; it must be 0 or more")
        self._period = period
        self._expert_port = expert_port
        self._student_port = student_port
        self._port_selector_port = self.DeclareAbstractOutputPort(
            name="port_selector",
            alloc=lambda: AbstractValue.Make(InputPortIndex(0)),
            calc=self._calc_port_selector,
            prerequisites_of_calc={self.time_ticket()},
        )

    def get_port_selector_output_port(self) -> OutputPort:
        """Gives the switch's input that acts."""
        return self._port_selector_port

    def _calc_port_selector(self, context: Context, output: AbstractValue) -> None:
        step = round(context.get_time() / CONTROL_PERIOD)
        acts = bool(expert_acts(step, self._period))
        output.set_value(self._expert_port if acts else self._student_port)
