"""Which requests of an operator a robot's day takes: what its mode cannot take is dropped.

A request is a number of `REQUESTS` that holds until another one is given. Without a gate, one that
changes nothing in a mode would act in a later one, when its operator may have forgotten it. What is
dropped is not remembered: it is given again, and a button is let go before it is pressed again.
"""

import logging
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations, product
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glassgait.models.task.day import POLICY, PROPOSITIONS, REQUESTS, Day, possible
from glassgait.models.task.formula import valuations

NO_MODE: Final = -1
"""In place of a mode's number: the robot follows no controller with a day."""

SIT: Final = REQUESTS.index("sit")

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class RequestGate:
    """Takes requests that the robot's mode can take, and drops others.

    A mode takes a request if its policy acts, or if it may lead elsewhere by it than by the one
    that holds.

    Attributes:
        day: The robot's day; None of one that is not known, whose modes take everything.
    """

    day: Day | None

    def settled(self, mode: int, before: int, asked: int) -> int:
        """Returns the number of what is requested now; what is dropped or ends is logged.

        Args:
            mode: Number of the mode; where it is `NO_MODE` the robot is to sit.
            before: Number of what was requested at the control step before.
            asked: Number of what is asked for newly; `before` where nothing is.
        """
        if mode == NO_MODE:
            if before != SIT:
                _LOG.warning(
                    f"the request to {REQUESTS[before]} ends, and the robot is to sit: it no "
                    "longer follows a controller with a day; give it again later"
                )
            if asked not in (before, SIT):
                _LOG.warning(self._refusal(mode, asked))
            return SIT
        if asked == before or self.takes(mode, before, asked):
            return asked
        _LOG.warning(self._refusal(mode, asked))
        return before

    def takes(self, mode: int, before: int, asked: int) -> bool:
        """Returns whether a mode takes a request in place of another one."""
        if mode == NO_MODE:
            return False
        if self.day is None or not 0 <= mode < len(self.day.modes):
            return True
        return bool(self._taken[mode, before, asked])

    @cached_property
    def _taken(self) -> NDArray[np.bool_]:
        """Whether a mode takes a request in place of another (n_modes, before, asked)."""
        assert self.day is not None
        acts = np.array([mode.joints == POLICY for mode in self.day.modes.values()])
        led = [self._led(number) for number in range(len(REQUESTS))]
        taken = np.zeros((len(acts), len(REQUESTS), len(REQUESTS)), dtype=bool)
        taken[acts] = True
        for before, asked in permutations(range(len(REQUESTS)), 2):
            for own, other in product(led[before], led[asked]):
                taken[:, before, asked] |= np.any(own != other, axis=1)
        return taken

    def _led(self, request: int) -> list[NDArray[np.int64]]:
        """Returns where modes lead by a request, by all else that can hold (n_modes, n): for a
        command that is not to go, and for one that is where there is one."""
        assert self.day is not None
        names, can_be = PROPOSITIONS.names, possible()
        asked = [names.index(name) for name in (*REQUESTS, "go")]
        others = np.flatnonzero(~valuations(len(names))[:, asked].any(axis=1))
        others = others[can_be[others | 1 << SIT]]
        codes = others | 1 << request
        going = codes | 1 << names.index("go")
        every = self.day.next_modes
        return [every[:, codes], *([every[:, going]] if can_be[going].any() else [])]

    def _refusal(self, mode: int, asked: int) -> str:
        why = "follows no controller with a day"
        if mode != NO_MODE:
            assert self.day is not None
            why = f"is in the mode {self.day.names[mode]!r}, which does not take it"
        return f"the request to {REQUESTS[asked]} is dropped: the robot {why}; give it again later"
