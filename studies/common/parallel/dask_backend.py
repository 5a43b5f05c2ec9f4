"""A Dask cluster, which makes calls again where a worker or a node is lost.

joblib's own Dask backend takes every worker, whatever number of jobs is asked for, and of a cluster
of one core none at all.
"""

import logging
import os
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any

from numpy.typing import NDArray

from glassgait.models.errors import InputError, brief
from glassgait.studies.common.parallel.cluster import WORKER_LOST, run_in_worker

WORKERS_AWAITED = 30.0
"""Seconds without a result after which a cluster without workers is given up."""


class DaskCluster:
    """The cluster that DASK_SCHEDULER_ADDRESS or Dask's own settings name, or else a new one of
    this machine's cores, which ends with this process.
    """

    def __init__(self) -> None:
        """
        Raises:
            InputError: if Dask is not installed, no cluster answers, or a worker has many threads.
        """
        try:
            distributed: Any = import_module("distributed")
        except ImportError as error:
            raise InputError(
                "--backend dask: Dask is not installed; run pip install 'glassgait[dask]'"
            ) from error
        self._dask = distributed
        # What a loop or a worker that is cut off leaves behind is no news: the command says so.
        for name in ("distributed", "tornado.application", "asyncio"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
        try:
            # The client of this process, if it has one.
            self._client = distributed.default_client()
        except ValueError:
            self._client = self._connected()
        self._refuse_threads()

    def _connected(self) -> Any:
        address = import_module("dask.config").get("scheduler-address", None)
        if address is None:
            n_cores = os.cpu_count() or 1
            cluster = self._dask.LocalCluster(
                n_workers=n_cores, threads_per_worker=1, dashboard_address=None
            )
            return self._dask.Client(cluster)
        try:
            return self._dask.Client(address)
        except (OSError, ValueError) as error:
            raise InputError(
                f"--backend dask: no scheduler answers at {address} ({brief(str(error))}); start "
                "one with 'dask scheduler', or mend DASK_SCHEDULER_ADDRESS"
            ) from error

    def _refuse_threads(self) -> None:
        # Random numbers and the working folder are a process's: two calls in one would share them.
        if any(n_threads > 1 for n_threads in self._client.nthreads().values()):
            raise InputError(
                "--backend dask: a worker has several threads; start workers with 'dask worker "
                "--nthreads 1 --nworkers N', N the number of the node's cores"
            )

    def n_cores(self) -> int:
        """Returns the number of workers."""
        return len(self._client.nthreads())

    def put(self, array: NDArray[Any]) -> Any:
        """Sends an array to every worker, so that it is not lost with one of them."""
        return self._client.scatter(array, broadcast=True, hash=False)

    def send(
        self, function: Callable[..., Any], values: Sequence[Any], named: Mapping[str, Any]
    ) -> Any:
        """Sends a call, and returns its ticket."""
        return self._client.submit(run_in_worker, function, *values, pure=False, **named)

    def first_done(self, tickets: Sequence[Any]) -> Any:
        """Waits until a call has ended, and returns its ticket.

        Raises:
            InputError: if the cluster has lost its last worker, and no other comes.
        """
        while True:
            try:
                ended = self._dask.wait(
                    tickets, timeout=WORKERS_AWAITED, return_when="FIRST_COMPLETED"
                )
                return next(iter(ended.done))
            except TimeoutError as error:
                if not self._client.nthreads():
                    raise InputError(
                        "--backend dask: the cluster has no worker any more; start workers, which "
                        "must have the same packages as this machine, and go on with --resume"
                    ) from error

    def result(self, ticket: Any) -> Any:
        """Returns what a call returned, or raises what it raised.

        Raises:
            InputError: if its workers were lost again and again.
        """
        try:
            return ticket.result()
        except self._dask.KilledWorker as error:
            raise InputError(WORKER_LOST) from error

    def cancel(self, tickets: Sequence[Any]) -> None:
        """Has calls not begin; one that runs ends by itself, and its result is dropped."""
        self._client.cancel(list(tickets))
