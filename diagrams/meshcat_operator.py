"""An operator who steers in Meshcat a robot that no diagram here simulates."""

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from glassgait.diagrams.gait_machine import mode_buttons
from glassgait.models.link.operator import Asked
from glassgait.models.link.remote import Remote
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.command import Command, CommandRange
from glassgait.systems.meshcat_command import SPEED_SLIDER, YAW_RATE_SLIDER, MeshcatCommand
from glassgait.systems.meshcat_gamepad import MeshcatGamepad


class MeshcatOperator:
    """Asks for what sliders, buttons and a gamepad in Meshcat do, looked at at each call.

    The robot is to step on the spot at first, and whenever no browser shows Meshcat: sliders then
    go back to their middle, so that it stays there when a browser comes back. L2 and B of the
    gamepad damp it for good, as on the robot's own remote.
    """

    def __init__(self, limits: CommandRange, meshcat: Meshcat, *, requests: bool) -> None:
        """
        Args:
            limits: Where sliders end.
            meshcat: Where they show.
            requests: Whether there are buttons for the modes of a day.
        """
        builder = DiagramBuilder()
        commander = builder.AddNamedSystem("command", MeshcatCommand(limits, meshcat))
        builder.ExportOutput(commander.get_command_output_port(), "command")
        builder.ExportOutput(commander.get_commanded_dwell_output_port(), "commanded_dwell")
        self._meshcat, self._gamepad = meshcat, MeshcatGamepad(meshcat)
        self._requests = requests
        self._stop()
        if requests:
            buttons = builder.AddNamedSystem("mode_request", mode_buttons(meshcat))
            builder.ExportOutput(buttons.get_requested_output_port(), "requested_mode")
        self._simulator, self._n_calls = Simulator(builder.Build()), 0
        self._simulator.Initialize()

    def __call__(self, _: Remote) -> Asked:
        """Returns what is asked for now; the robot's own remote is not read."""
        self._n_calls += 1
        if self._meshcat.GetNumActiveConnections() == 0:
            self._stop()
        self._simulator.AdvanceTo(self._n_calls * CONTROL_PERIOD)
        velocity, dwell = self._output("command"), self._output("commanded_dwell")[0]
        requested = int(self._output("requested_mode")[0]) if self._requests else 0
        held = self._gamepad.held()
        damped = held is not None and held.asks_to_damp
        return Asked(Command(velocity, np.array(dwell)), requested, damped)

    def _stop(self) -> None:
        for slider in (SPEED_SLIDER, YAW_RATE_SLIDER):
            self._meshcat.SetSliderValue(slider, 0.0)

    def _output(self, name: str) -> np.ndarray:
        port = self._simulator.get_system().GetOutputPort(name)
        return port.Eval(self._simulator.get_context()).copy()
