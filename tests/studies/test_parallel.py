"""Parallel loops: what they return, and how they end."""

import os
import signal
import socket
import subprocess
import sys
import threading
import time
import warnings

import psutil
import pytest
from joblib import delayed

from glassgait.models.errors import InputError
from glassgait.studies.common.parallel.cluster import ENDING
from glassgait.studies.common.parallel.loop import _signals_held, run_parallel

PARENT = """
import os, time
from joblib import delayed
from glassgait.studies.common.parallel.loop import run_parallel

os.cpu_count = lambda: 2

def work():
    time.sleep(0.2)
    return os.getpid()

for worker in run_parallel((delayed(work)() for _ in range(600)), 2):
    print(worker, flush=True)
"""


@pytest.fixture
def parent():
    """Starts a process whose workers are at work, in a group of its own."""
    process = subprocess.Popen(
        [sys.executable, "-c", PARENT],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    yield process
    process.kill()
    process.wait()


def _workers(process):
    return {psutil.Process(int(process.stdout.readline())) for _ in range(6)}


def _gone(processes, seconds):
    _, alive = psutil.wait_procs(processes, timeout=seconds)
    return not alive


def test_results_come_in_the_order_of_the_calls():
    assert list(run_parallel((delayed(abs)(-i) for i in range(9)), 2)) == list(range(9))
    loose = run_parallel((delayed(abs)(-i) for i in range(9)), 2, in_order=False)
    assert sorted(loose) == list(range(9))


def test_abandoned_results_raise_no_warning():
    results = run_parallel((delayed(time.sleep)(0.1) for _ in range(9)), 2)
    next(results)
    with warnings.catch_warnings(action="error"):
        results.close()


def test_a_worker_that_is_killed_is_reported():
    with pytest.raises(InputError, match="worker process"):
        list(run_parallel((delayed(os._exit)(1) for _ in range(4)), 2))


@pytest.mark.parametrize("number", ENDING)
def test_signals_wait_until_workers_have_started_whoever_lets_them_through(number):
    came, at_once = [], []

    def send():
        # As a library's thread, which blocks no signals.
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {number})
        ready.wait()
        os.kill(os.getpid(), number)
        sent.set()

    ready, sent = threading.Event(), threading.Event()
    before = signal.signal(number, lambda *_: came.append(number))
    try:
        thread = threading.Thread(target=send)
        thread.start()
        with _signals_held():
            ready.set()
            sent.wait()
            time.sleep(0.2)
            at_once += came
        thread.join()
    finally:
        signal.signal(number, before)
    assert (at_once, came) == ([], [number])


def test_one_at_a_time_stays_in_this_process():
    assert set(run_parallel((delayed(os.getpid)() for _ in range(3)), 1)) == {os.getpid()}


@pytest.mark.slow
def test_workers_end_with_a_parent_that_is_killed(parent):
    workers = _workers(parent)
    assert workers
    os.kill(parent.pid, signal.SIGKILL)
    assert _gone(workers, 10)


@pytest.mark.parametrize(
    "number",
    [
        pytest.param(number, marks=() if number == signal.SIGINT else pytest.mark.slow)
        for number in ENDING
    ],
)
def test_workers_leave_signals_to_their_parent(parent, number):
    workers = _workers(parent)
    # As a terminal's Ctrl-C does: to every process of the group.
    for worker in workers:
        os.kill(worker.pid, number)
    time.sleep(0.5)
    assert all(worker.is_running() for worker in workers)
    os.killpg(parent.pid, signal.SIGINT)
    _, message = parent.communicate(timeout=30)
    assert _gone(workers, 10)
    assert message.count("Traceback") == 1
    assert message.strip().endswith("KeyboardInterrupt")


def test_a_ray_cluster_that_is_not_there_is_refused_at_once(monkeypatch):
    pytest.importorskip("ray", reason="Ray is not installed: pip install 'glassgait[ray]'")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        # Bound, so that nobody else takes the port, but nothing listens there.
        monkeypatch.setenv("RAY_ADDRESS", f"127.0.0.1:{free.getsockname()[1]}")
        with pytest.raises(InputError, match="RAY_ADDRESS"):
            list(run_parallel([delayed(abs)(-1)], 1, backend="ray"))
