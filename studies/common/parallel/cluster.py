"""The parallel loop over a cluster, whichever it is: what is sent, when, and what comes back."""

import threading
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from itertools import islice
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from glassgait.studies.common.exit_codes import SIGNALS

ENDING = tuple(SIGNALS)
"""Signals that end a command; its workers leave them to it."""

WORKER_LOST = (
    "a worker process was ended from outside, most likely for lack of memory; free some or ask for "
    "fewer at once, then continue with --resume"
)
"""What a loop reports that lost a worker, or on a cluster too many of them."""

in_worker = threading.Event()
"""Set in a process that is a worker: its cores are its siblings'."""


def run_in_worker(function: Callable[..., Any], *values: Any, **named: Any) -> Any:
    """Makes a call in a worker of a cluster, on one thread, as workers of this machine do."""
    in_worker.set()
    with threadpool_limits(1):
        return function(*values, **named)


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
