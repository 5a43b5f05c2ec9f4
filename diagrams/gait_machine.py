"""The machine that follows the gait, and what requests another gait, or a mode of a day."""

from collections.abc import Sequence

from pydrake.geometry import Meshcat
from pydrake.systems.framework import DiagramBuilder, InputPort, OutputPort

from glassgait.diagrams.commands import CommandConfig, SliderCommand
from glassgait.models.link.gamepad import requested_gait
from glassgait.models.link.remote import requested_mode
from glassgait.models.task.day import REQUESTS, Day
from glassgait.models.task.gait import Gait
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.models.task.request import RequestGate
from glassgait.systems.gait_switch import GaitSwitchSystem
from glassgait.systems.meshcat_request import MeshcatRequest
from glassgait.systems.reward_machine import RewardMachineSystem

GAIT_KEYS = [f"Digit{number}" for number in range(1, 10)]
"""Keys beside the buttons of gaits."""

MODE_KEYS = ("KeyJ", "KeyK", "KeyL")
"""Keys beside the buttons of a day's requests."""


def AddGaitMachine(  # noqa: N802
    builder: DiagramBuilder,
    gait: Gait | GaitSwitch,
    config: CommandConfig,
    meshcat: Meshcat | None,
) -> RewardMachineSystem:
    """Adds the reward machine of a gait, or that of several.

    Of several gaits one is requested by a button in Meshcat, where commands come from sliders
    there, and else by the diagram's input `requested_gait`.
    """
    if isinstance(gait, Gait):
        return builder.AddNamedSystem("reward_machine", RewardMachineSystem(gait))
    machine = builder.AddNamedSystem("reward_machine", GaitSwitchSystem(gait))
    port = machine.get_requested_gait_input_port()
    if isinstance(config, SliderCommand) and meshcat is not None:
        buttons = builder.AddNamedSystem(
            "gait_request", gait_buttons([own.name for own in gait.gaits], meshcat)
        )
        builder.Connect(buttons.get_requested_output_port(), port)
    else:
        builder.ExportInput(port, "requested_gait")
    return machine


def AddModeRequest(  # noqa: N802
    builder: DiagramBuilder,
    day: Day,
    port: InputPort,
    mode: OutputPort,
    config: CommandConfig,
    meshcat: Meshcat | None,
) -> None:
    """Lets an operator request modes of a day, by buttons as gaits, or by a diagram's input.

    Args:
        builder: Where buttons are added.
        day: The day, whose modes drop what they cannot take of buttons.
        port: What takes the request (1).
        mode: The number of the mode that the day is in (1), or `NO_MODE`.
        config: Where commands come from.
        meshcat: Where buttons show.
    """
    if isinstance(config, SliderCommand) and meshcat is not None:
        buttons = builder.AddNamedSystem("mode_request", mode_buttons(RequestGate(day), meshcat))
        builder.Connect(mode, buttons.get_mode_input_port())
        builder.Connect(buttons.get_requested_output_port(), port)
    else:
        builder.ExportInput(port, "requested_mode")


def gait_buttons(gaits: Sequence[str], meshcat: Meshcat, first: int = 0) -> MeshcatRequest:
    """Makes buttons that request gaits, with the keys 1, 2, …, and a gamepad's R1 and L1.

    Args:
        gaits: Their names.
        meshcat: Where the buttons show.
        first: Number of the gait that is requested at first.
    """
    return MeshcatRequest(
        gaits,
        meshcat,
        keys=GAIT_KEYS,
        first=first,
        by_gamepad=lambda now, before, asked: requested_gait(now, before, asked, len(gaits)),
    )


def mode_buttons(gate: RequestGate, meshcat: Meshcat) -> MeshcatRequest:
    """Makes buttons that request what a day knows, with keys and a gamepad's buttons."""
    return MeshcatRequest(
        REQUESTS,
        meshcat,
        keys=MODE_KEYS,
        by_gamepad=requested_mode,
        gate=gate,
    )
