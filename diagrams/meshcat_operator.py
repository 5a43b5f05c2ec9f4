"""An operator who steers in Meshcat a robot that no diagram here simulates."""

from collections.abc import Sequence

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from glassgait.diagrams.gait_machine import gait_buttons, mode_buttons
from glassgait.models.link.operator import Asked
from glassgait.models.link.remote import Remote
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.command import Command, CommandRange
from glassgait.models.task.request import RequestGate
from glassgait.systems.meshcat_command import MeshcatCommand
from glassgait.systems.meshcat_gamepad import MeshcatGamepad


class MeshcatOperator:
    """Asks for what sliders, buttons and a gamepad in Meshcat do, looked at at each call.

    The robot is to step on the spot at first, and whenever no browser shows Meshcat: sliders then
    go back to their middle, so that it stays there when a browser comes back. L2 and B of the
    gamepad damp it for good, as on the robot's own remote.
    """

    def __init__(
        self,
        limits: CommandRange,
        meshcat: Meshcat,
        *,
        gaits: Sequence[str] = (),
        gait: int = 0,
        gate: RequestGate | None = None,
    ) -> None:
        """
        Args:
            limits: Where sliders end.
            meshcat: Where they show.
            gaits: Names of the gaits; of several there are buttons.
            gait: Number of the one that is requested at first.
            gate: What takes requests of a day's modes, for which there are buttons; None without a
                day.
        """
        builder = DiagramBuilder()
        commander = builder.AddNamedSystem(
            "command", MeshcatCommand(limits, meshcat, attended=True)
        )
        builder.ExportOutput(commander.get_command_output_port(), "command")
        builder.ExportOutput(commander.get_commanded_dwell_output_port(), "commanded_dwell")
        self._gamepad = MeshcatGamepad(meshcat)
        self._has_day, self._changes = gate is not None, len(gaits) > 1
        if self._changes:
            buttons = builder.AddNamedSystem("gait_request", gait_buttons(gaits, meshcat, gait))
            builder.ExportOutput(buttons.get_requested_output_port(), "requested_gait")
        if gate is not None:
            buttons = builder.AddNamedSystem("mode_request", mode_buttons(gate, meshcat))
            builder.ExportInput(buttons.get_mode_input_port(), "mode")
            builder.ExportOutput(buttons.get_requested_output_port(), "requested_mode")
        self._simulator, self._n_calls = Simulator(builder.Build()), 0

    def __call__(self, _: Remote, mode: int) -> Asked:
        """Returns what is asked for now; the robot's own remote is not read."""
        self._n_calls += 1
        if self._has_day:
            port = self._simulator.get_system().GetInputPort("mode")
            port.FixValue(self._simulator.get_mutable_context(), [float(mode)])
        self._simulator.AdvanceTo(self._n_calls * CONTROL_PERIOD)
        velocity, dwell = self._output("command"), self._output("commanded_dwell")[0]
        held = self._gamepad.held()
        return Asked(
            Command(velocity, np.array(dwell)),
            requested_mode=int(self._output("requested_mode")[0]) if self._has_day else 0,
            requested_gait=int(self._output("requested_gait")[0]) if self._changes else 0,
            damped=held is not None and held.asks_to_damp,
        )

    def _output(self, name: str) -> np.ndarray:
        port = self._simulator.get_system().GetOutputPort(name)
        return port.Eval(self._simulator.get_context()).copy()
