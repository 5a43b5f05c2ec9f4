"""What workers share, wherever they run."""

import signal
import threading
from collections.abc import Callable
from typing import Any

from threadpoolctl import threadpool_limits

ENDING = (signal.SIGINT, signal.SIGTERM)
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
