"""Where the two processes meet: the channels of their messages, and what is counted of each."""

import re
from dataclasses import dataclass, field
from typing import ClassVar

from glassgait.models.errors import InputError, shown
from glassgait.models.settings import Settings

LOCAL_URL = "udpm://239.255.76.67:7667?ttl=0"
"""LCM's own default: with a time to live of 0 no message leaves the machine."""

LONGEST_PREFIX = 32
"""Greatest length of the channels' prefix; LCM takes names of 63 characters."""

GREATEST_PORT = 65535

REMEMBERED = 1000
"""Missing numbers of messages that may still come late."""

_URL = re.compile(r"(udpm|tcpq)://[^\s/?#]+:(?P<port>\d{1,5})(\?\S*)?")
_PREFIX = re.compile(r"[A-Za-z0-9_.-]*")


@dataclass(frozen=True)
class Channels:
    """Names of the channels.

    Attributes:
        prefix: What they begin with.
    """

    prefix: str = ""

    @property
    def sensors(self) -> str:
        """Of `sensors_t`, from the robot."""
        return f"{self.prefix}SENSORS"

    @property
    def command(self) -> str:
        """Of `command_t`, from the operator."""
        return f"{self.prefix}COMMAND"

    @property
    def targets(self) -> str:
        """Of `targets_t`, from the controller."""
        return f"{self.prefix}TARGETS"


@dataclass(frozen=True)
class LinkSettings(Settings):
    """Where messages go.

    Attributes:
        lcm_url: LCM's provider: `udpm://…`, by default on this machine alone, or `tcpq://host:port`
            of a server.
        channels: What the names of the channels begin with: two robots on one machine need two.
    """

    title: ClassVar[str] = "link"

    lcm_url: str = LOCAL_URL
    channels: str = "GLASSGAIT_"

    def __post_init__(self) -> None:
        super().__post_init__()
        url = _URL.fullmatch(self.lcm_url)
        if url is None:
            raise InputError(
                f"link: lcm_url is {shown(self.lcm_url)}; write {LOCAL_URL}, or tcpq://host:port"
            )
        if not 1 <= int(url["port"]) <= GREATEST_PORT:
            raise InputError(
                f"link: lcm_url is {shown(self.lcm_url)}, whose port is {url['port']}; give one "
                f"from 1 to {GREATEST_PORT}"
            )
        if len(self.channels) > LONGEST_PREFIX or not _PREFIX.fullmatch(self.channels):
            raise InputError(
                f"link: channels is {shown(self.channels)}; write letters, digits, '_', '-' and "
                f"'.', {LONGEST_PREFIX} at most"
            )

    @property
    def names(self) -> Channels:
        """Names of the channels."""
        return Channels(self.channels)


@dataclass
class Tally:
    """Counts the messages of one channel by their session and number.

    Attributes:
        heard: Messages that came, each number once.
        late: Those of them that came late.
        lost: Numbers between the first and the greatest of a session that never came.
        doubled: Messages whose number had come before.
        sessions: Sessions that they were of.
    """

    heard: int = 0
    late: int = 0
    lost: int = 0
    doubled: int = 0
    sessions: int = 0
    _session: int | None = field(default=None, repr=False)
    _greatest: int = field(default=0, repr=False)
    _missing: set[int] = field(default_factory=set, repr=False)

    def count(self, session: int, sequence: int, *, late: bool = False) -> None:
        """Counts a message.

        Args:
            session: Its session; with another one than before the numbers begin anew.
            sequence: Its number.
            late: Whether it came late.
        """
        if session != self._session:
            self._session, self._greatest = session, sequence - 1
            self._missing.clear()
            self.sessions += 1
        if sequence > self._greatest:
            skipped = range(self._greatest + 1, sequence)
            self._missing.update(skipped[-REMEMBERED:])
            self.lost += len(skipped)
            self._greatest = sequence
        elif sequence in self._missing:
            # It was overtaken, not lost.
            self._missing.remove(sequence)
            self.lost -= 1
        else:
            self.doubled += 1
            return
        self.heard += 1
        self.late += late

    def rows(self) -> dict[str, int]:
        """Returns the counts by name."""
        return {name: getattr(self, name) for name in ("heard", "late", "lost", "doubled")}
