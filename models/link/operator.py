"""What the operator of a robot on Unitree's wire asks for, at each control step."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from glassgait.models.link.remote import Remote, Sticks, remote_command, requested_mode
from glassgait.models.task.command import Command, CommandRange


class Asked(NamedTuple):
    """What is asked for.

    Attributes:
        command: The command.
        requested_mode: Number of what is requested of a day, one of `REQUESTS`.
        damped: Whether joints are to be damped for good, as by L2 and B.
    """

    command: Command
    requested_mode: int = 0
    damped: bool = False


Operator = Callable[[Remote], Asked]
"""Returns what is asked for, given what is done with the robot's remote."""


@dataclass
class RemoteOperator:
    """Asks for what the robot's own remote does; it remembers what was requested last.

    Attributes:
        limits: Its greatest speed and yaw rate are those of a stick at its end.
        sticks: How sticks command.
        dwell: The rhythm, which the remote does not command (control steps).
        requested: Number of what was requested last.
    """

    limits: CommandRange
    sticks: Sticks
    dwell: float
    requested: int = 0

    def __call__(self, remote: Remote) -> Asked:
        """Returns what is asked for now."""
        self.requested = requested_mode(remote, self.requested)
        command = remote_command(remote, self.limits, self.sticks, self.dwell)
        return Asked(command, self.requested, remote.asks_to_damp)
