"""The machine that follows the gait, and what requests another gait, or a mode of a day."""

from collections.abc import Sequence

from pydrake.geometry import Meshcat
from pydrake.systems.framework import DiagramBuilder, InputPort

from glassgait.diagrams.commands import CommandConfig, SliderCommand
from glassgait.models.link.gamepad import requested_gait
from glassgait.models.link.remote import requested_mode
from glassgait.models.task.day import REQUESTS
from glassgait.models.task.gait import Gait
from glassgait.models.task.gait_switch import GaitSwitch
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
        buttons = builder.AddNamedSystem("gait_request", gait_buttons(gait.gaits, meshcat))
        builder.Connect(buttons.get_requested_output_port(), port)
    else:
        builder.ExportInput(port, "requested_gait")
    return machine


def AddModeRequest(  # noqa: N802
    builder: DiagramBuilder, port: InputPort, config: CommandConfig, meshcat: Meshcat | None
) -> None:
    """Lets an operator request modes of a day, by buttons as gaits, or by a diagram's input.

    Args:
        builder: Where buttons are added.
        port: What takes the request (1).
        config: Where commands come from.
        meshcat: Where buttons show.
    """
    if isinstance(config, SliderCommand) and meshcat is not None:
        buttons = builder.AddNamedSystem("mode_request", mode_buttons(meshcat))
        builder.Connect(buttons.get_requested_output_port(), port)
    else:
        builder.ExportInput(port, "requested_mode")


def gait_buttons(gaits: Sequence[Gait], meshcat: Meshcat) -> MeshcatRequest:
    """Makes buttons that request gaits, with the keys 1, 2, …, and a gamepad's R1 and L1."""
    return MeshcatRequest(
        [gait.name for gait in gaits],
        meshcat,
        keys=GAIT_KEYS,
        by_gamepad=lambda now, before, asked: requested_gait(now, before, asked, len(gaits)),
    )


def mode_buttons(meshcat: Meshcat) -> MeshcatRequest:
    """Makes buttons that request what a day knows, with keys and a gamepad's buttons."""
    return MeshcatRequest(
        REQUESTS,
        meshcat,
        keys=MODE_KEYS,
        by_gamepad=lambda now, _, asked: requested_mode(now, asked),
    )
