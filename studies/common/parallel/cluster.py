"""The parallel loop over a cluster, whichever it is: what is sent, when, and what comes back."""

from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from itertools import islice
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

AHEAD = 2
"""Calls that are taken for each that can run at once, so that no worker waits; joblib's number."""

LARGE = 2**20
"""Size of an array from which on it is sent once for all calls that take it (bytes); loky's."""


class Cluster(Protocol):
    """Workers that make calls; a call that is sent is known by its ticket."""

    def n_cores(self) -> int:
        """Returns how many calls can run at once now, as nodes come and go."""
        ...

    def put(self, array: NDArray[Any]) -> Any:
        """Sends an array, and returns what stands for it in calls."""
        ...

    def send(
        self, function: Callable[..., Any], values: Sequence[Any], named: Mapping[str, Any]
    ) -> Any:
        """Sends a call, and returns its ticket."""
        ...

    def first_done(self, tickets: Sequence[Any]) -> Any:
        """Waits until a call has ended, and returns its ticket."""
        ...

    def result(self, ticket: Any) -> Any:
        """Returns what a call returned.

        Raises:
            InputError: if its workers were lost again and again.
        """
        ...

    def cancel(self, tickets: Sequence[Any]) -> None:
        """Ends calls, or sees to it that they do not begin."""
        ...


def run_on_cluster(
    cluster: Cluster, work: Iterable[Any], n_jobs: int, in_order: bool, ahead: int = AHEAD
) -> Generator[Any, None, None]:
    """Makes calls on a cluster and yields what they return.

    Args:
        cluster: The cluster.
        work: The calls, each made by `joblib.delayed`.
        n_jobs: Calls that run at once; -1 for as many as the cluster has cores.
        in_order: Whether results come in the order of the calls, or each as soon as it is there.
        ahead: Calls that are sent for each core, where no number is given.

    Raises:
        InputError: if a call's workers were lost again and again.
    """
    arrays = _Arrays(cluster)
    calls = iter(work)
    running: dict[Any, int] = {}
    done: dict[int, Any] = {}
    n_sent = n_yielded = 0
    try:
        while True:
            most = n_jobs if n_jobs > 0 else ahead * max(1, cluster.n_cores())
            for function, values, named in islice(calls, max(0, most - len(running))):
                sent = [arrays.sent(value) for value in values]
                sent_named = {name: arrays.sent(value) for name, value in named.items()}
                running[cluster.send(function, sent, sent_named)] = n_sent
                n_sent += 1
            if not running:
                return
            ticket = cluster.first_done(list(running))
            # It has ended, however it ended: what is asked to end again may end Ray itself.
            number = running.pop(ticket)
            done[number] = cluster.result(ticket)
            while done and (not in_order or n_yielded in done):
                yield done.pop(n_yielded if in_order else next(iter(done)))
                n_yielded += 1
    finally:
        cluster.cancel(list(running))


class _Arrays:
    """Large arrays of a loop's calls, each sent once."""

    def __init__(self, cluster: Cluster) -> None:
        self._cluster = cluster
        self._sent: dict[int, tuple[Any, Any]] = {}

    def sent(self, value: Any) -> Any:
        """Returns what stands for a value in a call."""
        if not isinstance(value, np.ndarray) or value.nbytes < LARGE:
            return value
        if id(value) not in self._sent:
            # The array is kept as well, so that no other gets its id.
            self._sent[id(value)] = (value, self._cluster.put(value))
        return self._sent[id(value)][1]
