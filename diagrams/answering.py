"""A controller's end, whatever the wire: from one message of sensors to the next."""

from abc import ABC, abstractmethod
from typing import Any

from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram

from glassgait.models.link.messages import command_t, sensors_t
from glassgait.models.task import CONTROL_PERIOD

MOST_MADE_UP = 50
"""Control steps without sensors that a controller makes up for; after more it starts anew."""


class Answering:
    """Takes a controller between messages through the instants of the sensors that it answers.

    Its time is that of the sensors. For steps whose sensors never came it goes on with those that
    it had, so that its reward machine counts them too. It starts anew where it is not followed, in
    another session, and after a longer gap.

    Attributes:
        diagram: The controller, with input ports `sensors` and `command`.
        simulator: Its simulator, at the instant that was answered last.
        answered: The sensors that were answered last; None before the first.
    """

    def __init__(self, diagram: Diagram) -> None:
        self.diagram, self.simulator = diagram, Simulator(diagram)
        self.answered: sensors_t | None = None

    def take(self, sensors: sensors_t, command: command_t) -> None:
        """Goes on to the instant of sensors; then the outputs are the answer to them."""
        instant, steps = sensors.sequence * CONTROL_PERIOD, self.steps_since(sensors)
        if sensors.followed and steps is not None and 0 < steps <= MOST_MADE_UP:
            self.simulator.AdvanceTo(instant)
        else:
            self._start_anew(instant)
        take_in(self.diagram, self.simulator, "sensors", sensors)
        take_in(self.diagram, self.simulator, "command", command)
        self.answered = sensors

    def request_gait(self, number: int) -> None:
        """Requests a gait of a controller of several."""
        port = self.diagram.GetInputPort("requested_gait")
        port.FixValue(self.simulator.get_mutable_context(), [float(number)])

    def steps_since(self, sensors: sensors_t) -> int | None:
        """Counts control steps since the sensors answered last; None in another session."""
        before = self.answered
        if before is None or before.session != sensors.session:
            return None
        return sensors.sequence - before.sequence

    def _start_anew(self, instant: float) -> None:
        context = self.simulator.get_mutable_context()
        self.diagram.SetDefaultContext(context)
        context.SetTime(instant)
        self.simulator.Initialize()


class AnsweringEnd(ABC):
    """The controller's end of a wire."""

    @abstractmethod
    def listen(self, seconds: float) -> None:
        """Hears messages for some time (s), or until one came."""

    @abstractmethod
    def answer(self) -> bool:
        """Answers the sensors that came since the last answer, if any, and returns whether."""

    @property
    @abstractmethod
    def n_foreign(self) -> int:
        """Number of messages of another kind, or another version, that came."""

    @abstractmethod
    def counts(self) -> dict[str, float]:
        """Returns what was counted of messages, by name."""

    def news(self) -> str | None:
        """Returns a sentence to report, once."""
        return None

    def leave(self) -> None:
        """Takes leave of the robot, before the process ends."""
        return


def take_in(diagram: Diagram, simulator: Simulator, name: str, message: Any) -> None:
    """Gives a message to an input port of a diagram."""
    port = diagram.GetInputPort(name)
    port.FixValue(simulator.get_mutable_context(), AbstractValue.Make(message))
