"""A Ray cluster, which makes calls again where a worker or a node is lost.

joblib's own Ray backend holds a pool of actors instead: it fails with the first node that is lost,
and its results come as a list alone.
"""

import os
import socket
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from importlib import import_module
from typing import Any

from numpy.typing import NDArray

from glassgait.models.errors import InputError, brief, shown
from glassgait.studies.common.exit_codes import handlers_kept
from glassgait.studies.common.parallel.cluster import ENDING, WORKER_LOST, run_in_worker

PATIENCE = 10.0
"""Seconds in which a cluster must answer."""

RETRIES = 3
"""Times that a call is made again whose worker was lost; Dask's number."""


class RayCluster:
    """The cluster that RAY_ADDRESS names, or one that `ray start` started on this machine, or else
    a new one of this machine's cores, which ends with this process.
    """

    def __init__(self) -> None:
        """
        Raises:
            InputError: if Ray is not installed, or no cluster answers.
        """
        # Set before Ray is imported: nothing is reported to its makers unless a person asks for it.
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        try:
            ray: Any = import_module("ray")
        except ImportError as error:
            raise InputError(
                "--backend ray: Ray is not installed; run pip install 'glassgait[ray]'"
            ) from error
        self._ray = ray
        if not ray.is_initialized():
            self._connect()
        self._task = ray.remote(num_cpus=1, max_retries=RETRIES)(run_in_worker)

    def _connect(self) -> None:
        _knock(os.environ.get("RAY_ADDRESS", ""))
        try:
            with _handlers_kept():
                self._ray.init(log_to_driver=False, logging_level="ERROR")
        except (ConnectionError, RuntimeError, ValueError) as error:
            raise InputError(
                f"--backend ray: no cluster answers ({brief(str(error))}); start one with 'ray "
                "start --head', or mend RAY_ADDRESS"
            ) from error

    def n_cores(self) -> int:
        """Returns the cores of all nodes."""
        return int(self._ray.cluster_resources().get("CPU", 0))

    def put(self, array: NDArray[Any]) -> Any:
        """Sends an array to this node, from which others fetch it once each."""
        return self._ray.put(array)

    def send(
        self, function: Callable[..., Any], values: Sequence[Any], named: Mapping[str, Any]
    ) -> Any:
        """Sends a call, and returns its ticket."""
        return self._task.remote(function, *values, **named)

    def first_done(self, tickets: Sequence[Any]) -> Any:
        """Waits until a call has ended, and returns its ticket."""
        (ticket, *_), _ = self._ray.wait(list(tickets))
        return ticket

    def result(self, ticket: Any) -> Any:
        """Returns what a call returned, or raises what it raised.

        Raises:
            InputError: if its workers were lost again and again.
        """
        try:
            return self._ray.get(ticket)
        except self._ray.exceptions.RayTaskError as error:
            # Ray's own message is the worker's whole traceback.
            raise error.cause from error
        except self._ray.exceptions.RayError as error:
            raise InputError(WORKER_LOST) from error

    def cancel(self, tickets: Sequence[Any]) -> None:
        """Ends calls together with their workers."""
        for ticket in tickets:
            with suppress(self._ray.exceptions.RayError):
                self._ray.cancel(ticket, force=True)


def _knock(address: str) -> None:
    """Asks whether anything listens at an address.

    Ray itself would wait for minutes, deaf to Ctrl-C.

    Raises:
        InputError: if nothing does.
    """
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not host or not port.isdecimal():
        # Such as `auto`: Ray finds out by itself.
        return
    try:
        socket.create_connection((host, int(port)), timeout=PATIENCE).close()
    except (OSError, OverflowError) as error:
        raise InputError(
            f"--backend ray: nothing answers at RAY_ADDRESS={shown(address)}; start a cluster "
            "there with 'ray start --head', or mend RAY_ADDRESS"
        ) from error


@contextmanager
def _handlers_kept() -> Iterator[None]:
    """Keeps this process's handlers of signals, of which Ray takes one."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    with handlers_kept(ENDING):
        yield
