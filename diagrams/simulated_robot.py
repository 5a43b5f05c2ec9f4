"""A simulated robot's end, whatever the wire: a plant that is taken on step by step."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from enum import IntEnum
from typing import Any, ClassVar

from pydrake.systems.framework import Diagram

from glassgait.diagrams.plant_state import recenter
from glassgait.diagrams.rollout import make_simulator
from glassgait.diagrams.scenario import Scenario
from glassgait.models.arrays import Array
from glassgait.models.task import CONTROL_PERIOD


class SimulatedRobot(ABC):
    """Takes a robot's diagram through control steps, each of `n_parts` steps of the plant.

    A control step is a call of `send`, and of `advance` for each part.

    Attributes:
        diagram: The robot.
        simulator: Its simulator.
        n_parts: Steps of the plant in a control period.
        step: Control steps since the start.
    """

    reported: ClassVar[Mapping[tuple[Any, Any], str]]
    """Sentences of the changes of phase that are reported."""

    counted: ClassVar[Mapping[str, IntEnum]]
    """Phases whose beginnings are counted, by the count's name."""

    held: ClassVar[IntEnum]
    """The phase in which joints go on by what came last."""

    slack: ClassVar[float] = CONTROL_PERIOD
    """By how much the robot may be late before its clock is put back (s)."""

    def __init__(self, diagram: Diagram, scenario: Scenario, seed: int) -> None:
        self.diagram = diagram
        self.simulator = make_simulator(diagram, seed=seed)
        self.n_parts = scenario.station.plant_steps()
        self.step = 0

    @abstractmethod
    def listen(self, seconds: float) -> None:
        """Hears messages for some time (s), or until one came."""

    @abstractmethod
    def send(self) -> None:
        """Sends what is due at this control instant."""

    def advance(self, part: int) -> None:
        """Hears what came, and takes a step of the plant."""
        self.listen(0.0)
        last = part == self.n_parts - 1
        # Between two steps of the plant nothing is due; at an instant itself rounding would decide
        # whether its updates are taken.
        if part == 0:
            recenter(self.diagram, self.simulator.get_mutable_context())
        share = 1.0 if last else (part + 0.5) / self.n_parts
        self.simulator.AdvanceTo((self.step + share) * CONTROL_PERIOD)
        self.step += last

    def output(self, name: str) -> Array:
        """Evaluates an output port of the diagram."""
        return self.diagram.GetOutputPort(name).Eval(self.simulator.get_context())

    @property
    @abstractmethod
    def answered(self) -> bool:
        """Whether what was sent at this control instant has been answered."""

    @property
    @abstractmethod
    def n_foreign(self) -> int:
        """Number of messages of another kind, or another version, that came."""

    @property
    @abstractmethod
    def phase(self) -> IntEnum:
        """What the joints do."""

    @property
    def fallen(self) -> bool:
        """Whether the robot is to be put back on its feet; by default it never is."""
        return False

    def put_back(self) -> None:
        """Puts the robot back on its feet, where it may be `fallen`."""
        raise NotImplementedError

    @abstractmethod
    def counts(self) -> dict[str, float]:
        """Returns what was counted of messages, by name."""
