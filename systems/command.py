"""Commands drawn at random; a fixed command is Drake's `ConstantVectorSource`."""

from functools import lru_cache, partial

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    InputPort,
    LeafSystem,
    OutputPort,
)

from glassgait.models.task import COMMAND_STEPS, CONTROL_PERIOD
from glassgait.models.task.command import Command, sample_commands
from glassgait.models.task.gait import Gait
from glassgait.models.task.randomization import seed_of
from glassgait.systems.cached_value import CachedValue


class RandomCommand(LeafSystem):
    """Draws a new command every 10 s.

    .. pydrake_system::

        name: RandomCommand
        input_ports:
        - seed
        output_ports:
        - command
        - commanded_dwell

    Inputs: seed (1), any number.
    Outputs: command (2; m/s, rad/s), forward speed and yaw rate, trunk frame.
    commanded_dwell (1, control steps).
    State: none; each command is a function of the seed and of the 10 s that time is in.
    Feedthrough: seed to both outputs.
    """

    def __init__(self, gait: Gait, speed_range: tuple[float, float] | None = None) -> None:
        """
        Args:
            gait: The gait, for its ranges.
            speed_range: Least and greatest forward speed (m/s); the gait's by default.

        Raises:
            ValueError: if the least speed is greater than the greatest.
        """
        super().__init__()
        if speed_range is not None and not speed_range[0] <= speed_range[1]:
            raise ValueError(f"command: speed_range is {speed_range}; give the least first")
        # Seeding a generator takes longer than anything else here, and the draw holds for 10 s.
        self._drawn = lru_cache(maxsize=8)(partial(_draw, gait, speed_range))
        self._seed_port = self.DeclareVectorInputPort("seed", 1)
        self._draw = CachedValue(
            self,
            "drawn command",
            self._calc_draw,
            {self.time_ticket(), self.all_input_ports_ticket()},
        )
        self._command_port = self.DeclareVectorOutputPort(
            name="command",
            size=2,
            calc=self._calc_command,
            prerequisites_of_calc={self._draw.ticket()},
        )
        self._commanded_dwell_port = self.DeclareVectorOutputPort(
            name="commanded_dwell",
            size=1,
            calc=self._calc_commanded_dwell,
            prerequisites_of_calc={self._draw.ticket()},
        )

    def get_seed_input_port(self) -> InputPort:
        """Takes the seed of the draws."""
        return self._seed_port

    def get_command_output_port(self) -> OutputPort:
        """Gives forward speed and yaw rate."""
        return self._command_port

    def get_commanded_dwell_output_port(self) -> OutputPort:
        """Gives the commanded iterations in a state."""
        return self._commanded_dwell_port

    def _calc_draw(self, context: Context) -> Command:
        step = round(context.get_time() / CONTROL_PERIOD)
        return self._drawn(seed_of(self._seed_port.Eval(context)), step // COMMAND_STEPS)

    def _calc_command(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._draw.Eval(context).velocity[0])

    def _calc_commanded_dwell(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._draw.Eval(context).dwell)


def _draw(gait: Gait, speed_range: tuple[float, float] | None, seed: int, interval: int) -> Command:
    generator = np.random.default_rng([seed, interval])
    return sample_commands(gait, 1, generator, speed_range)
