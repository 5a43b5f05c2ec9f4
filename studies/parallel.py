"""Loops in parallel processes, which end with the process that started them."""

import os
import signal
import sys
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from typing import Any

from joblib import Parallel
from joblib.externals.loky.process_executor import TerminatedWorkerError

from glassgait.models.errors import InputError

WATCH_PERIOD = 1.0
"""Seconds between two looks of a worker for its parent."""

ENDING = (signal.SIGINT, signal.SIGTERM)
"""Signals that end a command; its workers leave them to it."""

NO_LEAKS = "ignore:resource_tracker:UserWarning"
"""Silences what trackers of shared memory say where they clean up behind a process that is gone."""


def run_parallel(work: Iterable[Any], n_jobs: int, *, in_order: bool = True) -> Iterator[Any]:
    """Runs calls in processes and yields what they return.

    Args:
        work: The calls, each made by `joblib.delayed`.
        n_jobs: Calls that run at once, at most one a core; -1 for as many as there are cores.
        in_order: Whether results come in the order of the calls, or each as soon as it is there.

    Raises:
        InputError: if a worker was killed.
    """
    # With more workers than cores, each still computes on one core, as it does with as many.
    n_jobs = min(n_jobs, os.cpu_count() or 1)
    results = "generator" if in_order else "generator_unordered"
    loop = Parallel(n_jobs, return_as=results, initializer=_end_with, initargs=(os.getpid(),))
    try:
        with _signals_held():
            yields = loop(work)
        yield from yields
    except TerminatedWorkerError as error:
        raise InputError(
            "a worker process was ended from outside, most likely for lack of memory; free some or "
            "ask for fewer at once, then continue with --resume"
        ) from error


def _end_with(parent: int) -> None:
    """Ends this process when its parent has ended, were it by a signal that nothing can catch."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(WATCH_PERIOD)
        os._exit(1)

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
    """Notes the signals that come, and returns who handled them before."""
    # Blocking is not enough: it is this thread's alone, and libraries' threads let signals through.
    return {
        number: signal.signal(number, lambda came_now, _: came.append(came_now))
        for number in ENDING
        if signal.getsignal(number) not in (signal.SIG_IGN, None)
    }
