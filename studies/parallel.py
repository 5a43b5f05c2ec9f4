"""Loops in parallel processes, which end with the process that started them."""

import os
import signal
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from typing import Any

from joblib import Parallel

WATCH_PERIOD = 1.0
"""Seconds between two looks of a worker for its parent."""


def run_parallel(work: Iterable[Any], n_jobs: int, *, in_order: bool = True) -> Iterator[Any]:
    """Runs calls in processes and yields what they return.

    Args:
        work: The calls, each made by `joblib.delayed`.
        n_jobs: Calls that run at once, at most one a core; -1 for as many as there are cores.
        in_order: Whether results come in the order of the calls, or each as soon as it is there.
    """
    # With more workers than cores, each still computes on one core, as it does with as many.
    n_jobs = min(n_jobs, os.cpu_count() or 1)
    results = "generator" if in_order else "generator_unordered"
    loop = Parallel(n_jobs, return_as=results, initializer=_end_with, initargs=(os.getpid(),))
    with _interrupts_held():
        yields = loop(work)
    yield from yields


def _end_with(parent: int) -> None:
    """Ends this process when its parent has ended, were it by a signal that nothing can catch."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(WATCH_PERIOD)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Holds Ctrl-C back while workers start: they inherit that, and leave it to their parent."""
    # Python's tracker of shared memory lets Ctrl-C through again when it starts: it starts before.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
