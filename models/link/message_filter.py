"""Which LowState and LowCmd messages are believed, and what is counted of the others."""

from dataclasses import dataclass

from glassgait.models.link.dds import Heard
from glassgait.models.link.low_state import TICKS, is_finite
from glassgait.models.link.motors import MotorCommand, may_be_given, unpack_low_cmd
from glassgait.models.link.unitree_messages import Record, is_sound
from glassgait.models.robots.robot import Robot

MOST_LEAP = 1000
"""Greatest time from one state to the next that is believed (ms)."""


@dataclass
class Counts:
    """What was counted of the messages of one topic.

    Attributes:
        heard: Messages that were believed.
        lost: States that never came, by the ticks of those that did.
        corrupt: Messages whose checksum is wrong.
        useless: Messages that are not finite, or ask for what joints may not be given.
        old: States no later than one before, and states of a time that cannot be.
        others: Messages of another publisher than the first.
        foreign: Bytes that are no such message.
    """

    heard: int = 0
    lost: int = 0
    corrupt: int = 0
    useless: int = 0
    old: int = 0
    others: int = 0
    foreign: int = 0

    def rows(self, what: str, *, timed: bool) -> dict[str, float]:
        """Returns the counts by name, but that of foreign ones.

        Args:
            what: What the messages are.
            timed: Whether they say when they were sent: else none is known to be lost or old.
        """
        names = {
            "heard": "heard",
            **({"lost": "lost", "old": "that are old"} if timed else {}),
            "corrupt": "with a wrong checksum",
            "useless": "that are useless",
            "others": "of another publisher",
        }
        return {f"{what} {name}": getattr(self, key) for key, name in names.items()}


class StateFilter:
    """Believes the states of the publisher that is heard first, each later than the one before.

    Attributes:
        counts: What came.
        bad: How many states of that publisher were bad since the last good one.
    """

    def __init__(self) -> None:
        self.counts, self.bad = Counts(), 0
        self._publisher: int | None = None
        self._tick: int | None = None

    def believed(self, heard: Heard) -> Record | None:
        """Returns a state if it is believed, else None."""
        counts, message = self.counts, heard.message
        if message is None:
            counts.foreign += 1
            return None
        if self._publisher not in (None, heard.publisher):
            counts.others += 1
            return None
        if not self._is_good(message):
            self.bad += 1
            return None
        self.bad = 0
        tick = int(message["tick"])
        if self._tick is not None:
            elapsed = tick - self._tick
            if not 0 < elapsed <= MOST_LEAP:
                counts.old += 1
                return None
            counts.lost += max(round(elapsed / TICKS) - 1, 0)
        self._publisher, self._tick = heard.publisher, tick
        counts.heard += 1
        return message

    def _is_good(self, message: Record) -> bool:
        if not is_sound(message):
            self.counts.corrupt += 1
            return False
        if not is_finite(message):
            self.counts.useless += 1
            return False
        return True


class CommandFilter:
    """Believes the commands of the publisher that is heard first, as long as it is heard.

    Attributes:
        counts: What came.
    """

    def __init__(self, robot: Robot) -> None:
        self.counts = Counts()
        self._robot = robot
        self._publisher: int | None = None
        self._message: Record | None = None
        self._command: MotorCommand | None = None

    def believed(self, heard: Heard) -> MotorCommand | None:
        """Returns a command if it is believed, else None."""
        counts, message = self.counts, heard.message
        if message is None:
            counts.foreign += 1
            return None
        # Ten commands in a row are the same one: what was judged once is not judged again.
        again = message is self._message
        if not again and not is_sound(message):
            counts.corrupt += 1
            return None
        if self._publisher not in (None, heard.publisher):
            counts.others += 1
            return None
        if not again:
            self._message, self._command = message, self._read(message)
        if self._command is None:
            counts.useless += 1
            return None
        self._publisher = heard.publisher
        counts.heard += 1
        return self._command

    def _read(self, message: Record) -> MotorCommand | None:
        command = unpack_low_cmd(self._robot, message)
        return command if command is not None and may_be_given(self._robot, command) else None

    def release(self) -> None:
        """Believes the next publisher that is heard: the one before is silent."""
        self._publisher = None
