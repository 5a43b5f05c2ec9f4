"""Parallel loops: what they return, and how they end."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest
from joblib import delayed

from studies.parallel import run_parallel

PARENT = """
import os, time
from joblib import delayed
from studies.parallel import run_parallel

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
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])},
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


def test_one_at_a_time_stays_in_this_process():
    assert set(run_parallel((delayed(os.getpid)() for _ in range(3)), 1)) == {os.getpid()}


def test_workers_end_with_a_parent_that_is_killed(parent):
    workers = _workers(parent)
    assert workers
    os.kill(parent.pid, signal.SIGKILL)
    assert _gone(workers, 10)


def test_workers_leave_an_interrupt_to_their_parent(parent):
    workers = _workers(parent)
    # As a terminal's Ctrl-C does: to every process of the group.
    for worker in workers:
        os.kill(worker.pid, signal.SIGINT)
    time.sleep(0.5)
    assert all(worker.is_running() for worker in workers)
    os.killpg(parent.pid, signal.SIGINT)
    _, told = parent.communicate(timeout=30)
    assert _gone(workers, 10)
    assert told.count("Traceback") == 1
    assert told.strip().endswith("KeyboardInterrupt")
