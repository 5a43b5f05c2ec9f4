"""Commands drawn at random; a fixed command is Drake's `ConstantVectorSource`."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem, OutputPort

from models.task import COMMAND_STEPS, CONTROL_PERIOD
from models.task.command import Command, sample_commands
from models.task.gait import Gait


class RandomCommand(LeafSystem):
    """Draws a new command every 10 s.

    .. pydrake_system::

        name: RandomCommand
        output_ports:
        - command
        - commanded_dwell

    Outputs: command (2; m/s, rad/s), forward speed and yaw rate, trunk frame.
    commanded_dwell (1, control steps).
    Parameters: seed (1), a whole number.
    State: none; each command is a function of the seed and of the 10 s that time is in.
    Feedthrough: none.
    """

    def __init__(
        self, gait: Gait, seed: int = 0, speed_range: tuple[float, float] | None = None
    ) -> None:
        """
        Args:
            gait: The gait, for its ranges.
            seed: Seed of the draws, as a fresh context has it.
            speed_range: Least and greatest forward speed (m/s); the gait's by default.
        """
        super().__init__()
        self._gait = gait
        self._speed_range = speed_range
        self._seed = self.DeclareNumericParameter(BasicVector([float(seed)]))
        prerequisites = {self.time_ticket(), self.all_parameters_ticket()}
        self._command_port = self.DeclareVectorOutputPort(
            name="command",
            size=2,
            calc=self._calc_command,
            prerequisites_of_calc=prerequisites,
        )
        self._commanded_dwell_port = self.DeclareVectorOutputPort(
            name="commanded_dwell",
            size=1,
            calc=self._calc_commanded_dwell,
            prerequisites_of_calc=prerequisites,
        )

    def get_command_output_port(self) -> OutputPort:
        """Gives forward speed and yaw rate."""
        return self._command_port

    def get_commanded_dwell_output_port(self) -> OutputPort:
        """Gives the commanded iterations in a state."""
        return self._commanded_dwell_port

    def set_seed(self, context: Context, seed: int) -> None:
        """Changes the seed in this system's own context."""
        context.get_mutable_numeric_parameter(self._seed).SetAtIndex(0, float(seed))

    def _draw(self, context: Context) -> Command:
        seed = int(context.get_numeric_parameter(self._seed)[0])
        step = round(context.get_time() / CONTROL_PERIOD)
        generator = np.random.default_rng([seed, step // COMMAND_STEPS])
        return sample_commands(self._gait, 1, generator, self._speed_range)

    def _calc_command(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._draw(context).velocity[0])

    def _calc_commanded_dwell(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._draw(context).dwell)
