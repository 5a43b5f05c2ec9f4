"""Counting messages that come, come late, twice, or never."""

from dataclasses import dataclass, field

REMEMBERED = 1000
"""Missing numbers that may still come late."""


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
