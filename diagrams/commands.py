"""Sources of commands: fixed, drawn at random, or sliders."""

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
from glassgait.systems.commands import GivenCommand, MeshcatCommand, RandomCommand


@checked
class FixedCommand(Settings):
    """One command for the whole rollout."""

    title: ClassVar[str] = "command"

    speed: float = 0.5  # forward (m/s)
    yaw_rate: float = 0.0  # rad/s
    dwell: Annotated[int, Ge(1)] = 8  # control steps in a state of the reward machine

    def of_robots(self, count: int) -> Command:
        """Returns the command of each robot: velocities (count, 2) and dwells (count,)."""
        velocity = np.tile([self.speed, self.yaw_rate], (count, 1))
        return Command(velocity, np.full(count, float(self.dwell)))

    def check(self, gait: Gait) -> None:
        """Raises an InputError if a value is beyond the gait's range."""
        check_command(gait, **asdict(self))


@checked
class DrawnCommands(Settings):
    """Commands drawn over the gait's range, a new one every 10 s."""

    title: ClassVar[str] = "command"

    speed_range: Range | None = None  # forward (m/s); the gait's by default

    def check(self, gait: Gait) -> None:
        """Raises an InputError if a speed is beyond the gait's range."""
        if any(abs(speed) > gait.max_speed for speed in self.speed_range or ()):
            raise InputError(
                f"{self.title}: speed_range is {shown(self.speed_range)}; name speeds from "
                f"{-gait.max_speed:g} to {gait.max_speed:g} m/s, the range of gait {gait.name!r}"
            )


@checked
class SliderCommand(Settings):
    """Commands from sliders in Meshcat."""

    title: ClassVar[str] = "command"

    # This key distinguishes it from other commands in a file.
    sliders: Literal[True] = True

    def check(self, gait: Gait) -> None:
        """Does nothing, since the sliders have the gait's range."""


NAMES = ("command", "commanded_dwell")  # names of the ports

CommandConfig = FixedCommand | DrawnCommands | SliderCommand


def AddCommand(  # noqa: N802
    builder: DiagramBuilder, gait: Gait, config: CommandConfig, meshcat: Meshcat | None
) -> dict[str, OutputPort]:
    """Adds a source of commands, and exports inputs with which a planner overrides it.

    Returns the outputs command (2; m/s, rad/s) and commanded_dwell (1, control steps).
    """
    config.check(gait)

    # The source of the scenario's commands.
    match config:
        case FixedCommand(speed=speed, yaw_rate=yaw_rate, dwell=dwell):
            sources = [ConstantVectorSource([speed, yaw_rate]), ConstantVectorSource([dwell])]
            for name, source in zip(NAMES, sources, strict=True):
                builder.AddNamedSystem(name, source)
            drawn = [source.get_output_port() for source in sources]
        case DrawnCommands(speed_range=speed_range):
            seed = AddSeed(builder, "command_seed")
            source = builder.AddNamedSystem("command", RandomCommand(gait, speed_range))
            builder.Connect(seed, source.get_input_port())
            drawn = [source.GetOutputPort(name) for name in NAMES]
        case SliderCommand():
            if meshcat is None:
                raise InputError("locomotion: commands from sliders need a Meshcat; set `meshcat`")
            source = builder.AddNamedSystem("command", MeshcatCommand(gait, meshcat))
            drawn = [source.GetOutputPort(name) for name in NAMES]

    # The commands of a connected planner take precedence.
    given = builder.AddNamedSystem("given_command", GivenCommand(gait))
    builder.Connect(drawn[0], given.GetInputPort("drawn_command"))
    builder.Connect(drawn[1], given.GetInputPort("drawn_dwell"))
    for name in NAMES:
        builder.ExportInput(given.GetInputPort(name), name)
    return {name: given.GetOutputPort(name) for name in NAMES}


def AddSeed(builder: DiagramBuilder, name: str) -> OutputPort:  # noqa: N802
    """Adds a number that a random context draws and that stays constant in the rollout."""
    # A Python system cannot draw its parameters in `SetRandomContext`. This linear system draws its
    # initial state, which never changes. A RandomSource would draw again at its first update.
    nothing = np.zeros((1, 0))
    seed = LinearSystem(np.eye(1), nothing, np.eye(1), nothing, COMMAND_STEPS * CONTROL_PERIOD)
    seed.configure_random_state(np.eye(1))
    return builder.AddNamedSystem(name, seed).get_output_port()
