"""Loops in parallel processes: on this machine, where they end with the process that started
them, or on a cluster.
"""

import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Generator, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from multiprocessing import resource_tracker
from typing import Annotated, Any, Literal

from annotated_types import Lt
from joblib import Parallel
from joblib.externals.loky.process_executor import TerminatedWorkerError
from pydantic import AfterValidator

from glassgait.models.errors import InputError
from glassgait.studies.common.parallel.cluster import (
    AHEAD,
    ENDING,
    WORKER_LOST,
    Cluster,
    in_worker,
    run_on_cluster,
)

WATCH_PERIOD = 1.0
"""Seconds between two looks of a worker for its parent."""

NO_LEAKS = "ignore:resource_tracker:UserWarning"
"""Silences what trackers of shared memory say where they clean up behind a process that is gone."""

Backend = Literal["loky", "ray", "dask"]
"""Where calls run: in processes of this machine, or as tasks of a Ray or a Dask cluster."""


def _all_or_some(n_jobs: int) -> int:
    if n_jobs < 1 and n_jobs != -1:
        raise ValueError("1 or more, or -1 for as many as there are cores")
    return n_jobs


Jobs = Annotated[int, Lt(2**31), AfterValidator(_all_or_some)]
"""What is done at once, as joblib counts."""

_backend: ContextVar[Backend] = ContextVar("backend", default="loky")


@contextmanager
def parallel_backend(backend: Backend) -> Iterator[None]:
    """Chooses where the parallel loops within run that are not set otherwise."""
    token = _backend.set(backend)
    try:
        yield
    finally:
        _backend.reset(token)


def runs_here() -> bool:
    """Returns whether parallel loops run on this machine, as far as they are not set otherwise."""
    return _backend.get() == "loky"


def run_parallel(
    work: Iterable[Any],
    n_jobs: int,
    *,
    in_order: bool = True,
    backend: Backend | None = None,
    ahead: int = AHEAD,
) -> Generator[Any, None, None]:
    """Runs calls in other processes and yields what they return.

    Within a worker calls run one after another: its cores are its siblings'.

    Args:
        work: The calls, each made by `joblib.delayed`.
        n_jobs: Calls that run at once, at most one a core; -1 for as many as there are cores.
        in_order: Whether results come in the order of the calls, or each as soon as it is there.
        backend: Where they run; by default where `parallel_backend` says, or on this machine.
        ahead: Calls that are taken for each that can run at once.

    Raises:
        InputError: if a worker was killed, on a cluster more than three times in the same call, or
            there is no such cluster, or its extra is not installed.
    """
    if in_worker.is_set():
        return (function(*values, **named) for function, values, named in work)
    chosen = backend or _backend.get()
    if chosen == "loky":
        return _run_on_loky(work, n_jobs, in_order, ahead)
    return run_on_cluster(_cluster(chosen), work, n_jobs, in_order, ahead)


def _run_on_loky(
    work: Iterable[Any], n_jobs: int, in_order: bool, ahead: int
) -> Generator[Any, None, None]:
    # With more workers than cores, each still computes on one core, as it does with as many.
    n_jobs = min(n_jobs, os.cpu_count() or 1)
    results = "generator" if in_order else "generator_unordered"
    loop = Parallel(
        n_jobs,
        return_as=results,
        pre_dispatch=f"{ahead} * n_jobs",
        initializer=_end_with,
        initargs=(os.getpid(),),
    )
    try:
        with _signals_held():
            yields: Any = loop(work)
        try:
            for result in yields:  # noqa: UP028
                yield result
        except GeneratorExit:
            # joblib warns of results that nobody waited for: on Ctrl-C nobody does.
            with warnings.catch_warnings(action="ignore"):
                yields.close()
            raise
    except TerminatedWorkerError as error:
        raise InputError(WORKER_LOST) from error


def _cluster(backend: Backend) -> Cluster:
    # Imported here: Ray and Dask are extras, and slow to import.
    if backend == "ray":
        from glassgait.studies.common.parallel.ray_backend import RayCluster  # noqa: PLC0415

        return RayCluster()
    from glassgait.studies.common.parallel.dask_backend import DaskCluster  # noqa: PLC0415

    return DaskCluster()


def _end_with(parent: int) -> None:
    """Ends this process when its parent has ended, were it by a signal that nothing can catch."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(WATCH_PERIOD)
        os._exit(1)

    in_worker.set()
    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _signals_held() -> Iterator[None]:
    """Holds Ctrl-C and SIGTERM back while workers start, whose locks an exception would leave held.

    Workers inherit that these are blocked, and leave them to their parent.
    """
    if NO_LEAKS not in sys.warnoptions:
        sys.warnoptions.append(NO_LEAKS)
    # Python's tracker of shared memory lets both through again when it starts: it starts before.
    resource_tracker.ensure_running()
    came: list[int] = []
    handlers = _handled_by(came) if threading.current_thread() is threading.main_thread() else {}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        for number, handler in handlers.items():
            signal.signal(number, handler)
    if came:
        signal.raise_signal(came[0])


def _handled_by(came: list[int]) -> dict[signal.Signals, Any]:
    """Notes the signals that come, and returns their handlers of before."""
    # Blocking is not enough: it is this thread's alone, and libraries' threads let signals through.
    return {
        number: signal.signal(number, lambda came_now, _: came.append(came_now))
        for number in ENDING
        if signal.getsignal(number) not in (signal.SIG_IGN, None)
    }
