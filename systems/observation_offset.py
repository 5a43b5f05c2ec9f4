"""Gives a policy another observation than the robot's, for some control steps."""

from dataclasses import dataclass

from pydrake.systems.framework import BasicVector, Context, InputPort, LeafSystem, OutputPort

from glassgait.models.arrays import Array
from glassgait.models.task import CONTROL_PERIOD


@dataclass(frozen=True)
class Intervention:
    """A change of the observation that a policy is given, while the robot is as it is.

    Attributes:
        offset: What is added to the observation (n).
        first: The control step at which it begins.
        count: For how many control steps it lasts.
    """

    offset: Array
    first: int
    count: int = 1

    def applied(self, step: int, observation: Array) -> Array:
        """Returns what the policy is given (..., n) at a control step, of an observation."""
        lasts = self.first <= step < self.first + self.count
        return observation + self.offset if lasts else observation


class ObservationOffset(LeafSystem):
    """Adds an offset to the observation while an intervention lasts.

    .. pydrake_system::

        name: ObservationOffset
        input_ports:
        - observation
        output_ports:
        - given_observation

    Inputs: observation (n), the size of the intervention's offset.
    Outputs: given_observation (n), the observation, plus the offset at those control steps.
    State: none; a function of time. Feedthrough: yes.
    """

    def __init__(self, intervention: Intervention) -> None:
        super().__init__()
        self._intervention = intervention
        size = len(intervention.offset)
        self._observation_port = self.DeclareVectorInputPort(name="observation", size=size)
        self._given_observation_port = self.DeclareVectorOutputPort(
            name="given_observation",
            size=size,
            calc=self._calc_given_observation,
            prerequisites_of_calc={self.all_input_ports_ticket(), self.time_ticket()},
        )

    def get_observation_input_port(self) -> InputPort:
        """Takes the robot's observation."""
        return self._observation_port

    def get_given_observation_output_port(self) -> OutputPort:
        """Gives what the policy is to observe."""
        return self._given_observation_port

    def _calc_given_observation(self, context: Context, output: BasicVector) -> None:
        step = round(context.get_time() / CONTROL_PERIOD)
        observation = self._observation_port.Eval(context)
        output.SetFromVector(self._intervention.applied(step, observation))
