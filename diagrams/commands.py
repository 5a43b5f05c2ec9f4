"""Where a robot's commands come from: fixed, drawn, or sliders."""

from dataclasses import asdict
from typing import Annotated, ClassVar, Literal

import numpy as np
from annotated_types import Ge
from pydrake.geometry import Meshcat
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import ConstantVectorSource, LinearSystem

from glassgait.models.errors import InputError, shown
from glassgait.models.settings import Range, Settings, checked
from glassgait.models.task import COMMAND_STEPS, CONTROL_PERIOD
from glassgait.models.task.command import Command, check_command
from glassgait.models.task.gait import Gait
from glassgait.systems.command import RandomCommand
from glassgait.systems.given_command import GivenCommand
from glassgait.systems.meshcat_command import MeshcatCommand


@checked
class FixedCommand(Settings):
    """One command for the whole rollout.

    Attributes:
        speed: Forward speed (m/s).
        yaw_rate: Yaw rate (rad/s).
        dwell: Iterations to stay in a state of the reward machine (control steps).
    """

    title: ClassVar[str] = "command"

    speed: float = 0.5
    yaw_rate: float = 0.0
    dwell: Annotated[int, Ge(1)] = 8

    def of_robots(self, count: int) -> Command:
        """Returns the command of so many robots: velocities (count, 2) and dwells (count,)."""
        velocity = np.tile([self.speed, self.yaw_rate], (count, 1))
        return Command(velocity, np.full(count, float(self.dwell)))

    def check(self, gait: Gait) -> None:
        """Checks that a gait is made for the command.

        Raises:
            InputError: if a value is beyond the gait's range.
        """
        check_command(gait, **asdict(self))


@checked
class DrawnCommands(Settings):
    """Commands drawn over the gait's range, a new one every 10 s.

    Attributes:
        speed_range: Least and greatest forward speed (m/s); the gait's by default.
    """

    title: ClassVar[str] = "command"

    speed_range: Range | None = None

    def check(self, gait: Gait) -> None:
        """Checks that a gait is made for the commands.

        Raises:
            InputError: if a speed is beyond the gait's range.
        """
        if any(abs(speed) > gait.max_speed for speed in self.speed_range or ()):
            raise InputError(
                f"{self.title}: speed_range is {shown(self.speed_range)}; name speeds from "
                f"{-gait.max_speed:g} to {gait.max_speed:g} m/s, the range of gait {gait.name!r}"
            )


@checked
class SliderCommand(Settings):
    """Commands from sliders in Meshcat.

    Attributes:
        sliders: Distinguishes it from other commands in a file.
    """

    title: ClassVar[str] = "command"

    sliders: Literal[True] = True

    def check(self, gait: Gait) -> None:
        """Does nothing: sliders end where the gait's range does."""


CommandConfig = FixedCommand | DrawnCommands | SliderCommand


def AddCommand(  # noqa: N802
    builder: DiagramBuilder, gait: Gait, config: CommandConfig, meshcat: Meshcat | None
) -> tuple[OutputPort, OutputPort]:
    """Adds the source of commands.

    Returns:
        Its outputs: command (2; m/s, rad/s) and commanded_dwell (1, control steps).

    Raises:
        InputError: if the gait is not made for the command.
        ValueError: if there is no Meshcat for sliders.
    """
    config.check(gait)
    match config:
        case FixedCommand(speed=speed, yaw_rate=yaw_rate, dwell=dwell):
            velocity = ConstantVectorSource([speed, yaw_rate])
            builder.AddNamedSystem("command", velocity)
            rhythm = builder.AddNamedSystem("commanded_dwell", ConstantVectorSource([dwell]))
            return velocity.get_output_port(), rhythm.get_output_port()
        case DrawnCommands(speed_range=speed_range):
            source = _add_random_command(builder, gait, speed_range)
        case SliderCommand():
            if meshcat is None:
                raise ValueError("locomotion: commands from sliders need a Meshcat")
            source = builder.AddNamedSystem("command", MeshcatCommand(gait, meshcat))
    return source.get_command_output_port(), source.get_commanded_dwell_output_port()


def AddGivenCommand(  # noqa: N802
    builder: DiagramBuilder, gait: Gait, drawn: tuple[OutputPort, OutputPort]
) -> tuple[OutputPort, OutputPort]:
    """Adds what lets a planner command the robot, by the diagram's inputs of the same names.

    Args:
        builder: Where it is added.
        gait: The gait, for its ranges.
        drawn: What `AddCommand` returns, which is commanded where the inputs are unconnected.

    Returns:
        The outputs command (2; m/s, rad/s) and commanded_dwell (1, control steps).
    """
    given = builder.AddNamedSystem("given_command", GivenCommand(gait))
    command, dwell = drawn
    builder.Connect(command, given.get_drawn_command_input_port())
    builder.Connect(dwell, given.get_drawn_dwell_input_port())
    for port in (given.get_command_input_port(), given.get_commanded_dwell_input_port()):
        builder.ExportInput(port, port.get_name())
    return given.get_command_output_port(), given.get_commanded_dwell_output_port()


def AddSeed(builder: DiagramBuilder, name: str) -> OutputPort:  # noqa: N802
    """Adds a number that a random context draws, and that holds for the whole rollout."""
    # A system written in Python cannot draw its own parameters in `SetRandomContext`, but a linear
    # system draws its initial state, and this one stays where it starts. A RandomSource would draw
    # another number in the first update.
    nothing = np.zeros((1, 0))
    seed = LinearSystem(np.eye(1), nothing, np.eye(1), nothing, COMMAND_STEPS * CONTROL_PERIOD)
    seed.configure_random_state(np.eye(1))
    return builder.AddNamedSystem(name, seed).get_output_port()


def _add_random_command(
    builder: DiagramBuilder, gait: Gait, speed_range: tuple[float, float] | None
) -> RandomCommand:
    seed = AddSeed(builder, "command_seed")
    source = builder.AddNamedSystem("command", RandomCommand(gait, speed_range))
    builder.Connect(seed, source.get_seed_input_port())
    return source
