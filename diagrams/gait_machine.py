"""The machine that follows the gait, and what requests another gait of several."""

from pydrake.geometry import Meshcat
from pydrake.systems.framework import DiagramBuilder

from glassgait.diagrams.commands import CommandConfig, SliderCommand
from glassgait.models.task.gait import Gait
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.systems.gait_switch import GaitSwitchSystem
from glassgait.systems.meshcat_gait_request import MeshcatGaitRequest
from glassgait.systems.reward_machine import RewardMachineSystem


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
        buttons = MeshcatGaitRequest(gait.gaits, meshcat)
        builder.AddNamedSystem("gait_request", buttons)
        builder.Connect(buttons.get_requested_gait_output_port(), port)
    else:
        builder.ExportInput(port, "requested_gait")
    return machine
