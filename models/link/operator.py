"""What the operator of a robot on Unitree's wire asks for, at each control step."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

from glassgait.models.link.gamepad import requested_gait
from glassgait.models.link.remote import Remote, Sticks, remote_command, requested_mode
from glassgait.models.task.command import Command, CommandRange
from glassgait.models.task.request import NO_MODE, SIT, RequestGate


class Asked(NamedTuple):
    """What is asked for.

    Attributes:
        command: The command.
        requested_mode: Number of what is requested of a day, one of `REQUESTS`.
        requested_gait: Number of the gait that is to run, of a controller of several.
        damped: Whether joints are to be damped for good, as by L2 and B.
    """

    command: Command
    requested_mode: int = 0
    requested_gait: int = 0
    damped: bool = False


Operator = Callable[[Remote, int], Asked]
"""Returns what is asked for, given what is done with the robot's remote, and the number of the mode
that the robot's day is in, or `NO_MODE`."""


@dataclass
class RemoteOperator:
    """Asks for what the robot's own remote does; it remembers what was requested last.

    The buttons of `REQUESTED_BY` request modes of a day, R1 and L1 the gait beside.

    Attributes:
        limits: Its greatest speed and yaw rate are those of a stick at its end.
        sticks: How sticks command.
        dwell: The rhythm, which the remote does not command (control steps).
        n_gaits: Number of gaits.
        gate: What takes requests of a day's modes, or drops them; None without a day.
        requested: Number of what was requested last.
        gait: Number of the gait that was requested last.
        before: What was done with the remote a control step before: a button counts once.
    """

    limits: CommandRange
    sticks: Sticks
    dwell: float
    n_gaits: int = 1
    gate: RequestGate | None = None
    requested: int = SIT
    gait: int = 0
    before: Remote = field(default_factory=Remote.untouched, init=False)

    def __call__(self, remote: Remote, mode: int) -> Asked:
        """Returns what is asked for now."""
        before, self.before = self.before, remote
        if self.gate is not None:
            asked = requested_mode(remote, before, self.requested)
            self.requested = self.gate.settled(mode, self.requested, asked)
            remote = Remote.untouched() if mode == NO_MODE else remote
        self.gait = requested_gait(remote, before, self.gait, self.n_gaits)
        command = remote_command(remote, self.limits, self.sticks, self.dwell)
        return Asked(command, self.requested, self.gait, remote.asks_to_damp)
