"""Parallel loops over clusters: the results of this machine's, whatever nodes are lost."""

import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager

import numpy as np
import psutil
import pytest
from joblib import delayed

from glassgait.models.errors import InputError
from glassgait.models.files import digest
from glassgait.models.task.gait import gait_names
from glassgait.studies.common.parallel import dask_backend
from glassgait.studies.common.parallel.loop import parallel_backend, run_parallel

SMALL = {"num_cpus": 1, "object_store_memory": 80_000_000}
"""A node: one core, and little shared memory."""

PARENT = """
import os, sys, time
from joblib import delayed
from glassgait.studies.common.parallel.loop import run_parallel

def work():
    time.sleep(0.2)
    return os.getpid()

for worker in run_parallel((delayed(work)() for _ in range(600)), 2, backend=sys.argv[1]):
    print(worker, flush=True)
"""


@contextmanager
def two_nodes():
    """Starts a Ray cluster of two nodes on this machine, of which the second may be killed."""
    pytest.importorskip("ray", reason="Ray is not installed: pip install 'glassgait[ray]'")
    import ray  # noqa: PLC0415
    from ray.cluster_utils import Cluster  # noqa: PLC0415

    cluster = Cluster(initialize_head=True, head_node_args=SMALL | {"include_dashboard": False})
    try:
        second = cluster.add_node(**SMALL)
        os.environ["RAY_ADDRESS"] = cluster.address
        yield lambda: cluster.remove_node(second, allow_graceful=False)
    finally:
        os.environ.pop("RAY_ADDRESS", None)
        ray.shutdown()
        cluster.shutdown()


@contextmanager
def two_workers():
    """Starts a Dask cluster of two workers on this machine, of which one may be killed."""
    distributed = pytest.importorskip(
        "distributed", reason="Dask is not installed: pip install 'glassgait[dask]'"
    )
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    with distributed.LocalCluster(**options) as cluster, distributed.Client(cluster) as client:
        os.environ["DASK_SCHEDULER_ADDRESS"] = cluster.scheduler_address
        first, *_ = client.run(os.getpid).values()
        yield lambda: os.kill(first, signal.SIGKILL)
        os.environ.pop("DASK_SCHEDULER_ADDRESS")


CLUSTERS = {"ray": two_nodes, "dask": two_workers}

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module", params=CLUSTERS)
def backend(request):
    with CLUSTERS[request.param]():
        yield request.param


def _products(folder, held):
    """Returns calls that mark each try by a file, wait while asked to, and return numbers."""

    def work(matrix, seed):
        (folder / f"{seed}_{os.getpid()}_{time.time_ns()}").touch()
        while seed >= 4 and held.exists():
            time.sleep(0.05)
        return seed, matrix @ np.random.default_rng(seed).random(400)

    folder.mkdir()
    matrix = np.random.default_rng(0).random((400, 400))
    return (delayed(work)(matrix, seed) for seed in range(16))


def _lose_a_worker(kill, folder):
    """Waits until two workers are held within a call, kills one, waits until it is gone."""

    def held():
        tries = (path.name.split("_") for path in folder.iterdir())
        return {int(worker) for seed, worker, _ in tries if int(seed) >= 4}

    def until(reached):
        while not reached():
            time.sleep(0.05)

    until(lambda: len(held()) >= 2)
    workers = held()
    kill()
    until(lambda: not all(map(_runs, workers)))


def _runs(process_id):
    try:
        return psutil.Process(process_id).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def _refuse(value):
    raise InputError(f"{value}: is refused")


def _nested():
    return list(run_parallel((delayed(os.getpid)() for _ in range(3)), 2)), os.getpid()


def _n_threads():
    from threadpoolctl import threadpool_info  # noqa: PLC0415

    np.ones(1) @ np.ones(1)
    return [pool["num_threads"] for pool in threadpool_info()]


@pytest.mark.parametrize("name", CLUSTERS)
def test_a_lost_node_changes_no_result(name, tmp_path):
    held = tmp_path / "held"
    expected = list(run_parallel(_products(tmp_path / "loky", held), 2))
    held.touch()
    found = []
    with CLUSTERS[name]() as kill:
        work = _products(tmp_path / "cluster", held)
        for result in run_parallel(work, -1, in_order=False, backend=name):
            found.append(result)
            if len(found) == 4:
                _lose_a_worker(kill, tmp_path / "cluster")
                held.unlink()
    assert len(list((tmp_path / "cluster").iterdir())) > len(expected), "no call was made again"
    for (seed, product), (other_seed, other) in zip(expected, sorted(found), strict=True):
        assert seed == other_seed
        np.testing.assert_array_equal(product, other)


def _train(folder, *more):
    """Starts a sweep of six small trainings in a folder."""
    small = ["--n-robots", "8", "--n-groups", "1", "--fine-steps", "--updates", "4"]
    sweep = ["--gait", "all", "--checkpoint-updates", "2", "--output", folder.name]
    return subprocess.Popen(
        [sys.executable, "-m", "glassgait.studies.cli", "train", *sweep, *small, *more],
        cwd=folder.parent,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def _experts(folder):
    paths = [path for name in gait_names() for path in folder.rglob(f"{name}.safetensors")]
    return {path.relative_to(folder): digest(path) for path in paths}


def test_experts_of_a_sweep_that_loses_a_node_are_those_of_this_machine(tmp_path):
    here, there = tmp_path / "loky", tmp_path / "ray"
    here_alone = _train(here)
    here_alone.communicate(timeout=300)
    done = 0
    with two_nodes() as kill, _train(there, "--backend", "ray") as process:
        for line in process.stdout:
            if "done (" in line:
                done += 1
                if done == 2:
                    kill()
    assert (here_alone.returncode, process.returncode, done) == (0, 0, 6)
    assert len(_experts(here)) == 6
    assert _experts(there) == _experts(here)


def test_a_sweep_on_a_cluster_ends_on_a_signal(backend, tmp_path):
    process = _train(tmp_path / "experts", "--backend", backend)
    while "done (" not in process.stdout.readline():
        pass
    process.terminate()
    _, message = process.communicate(timeout=60)
    assert process.returncode == 128 + signal.SIGTERM
    assert message.strip().endswith("what was finished is kept")
    assert "Traceback" not in message


def test_results_come_in_the_order_of_the_calls(backend):
    with parallel_backend(backend):
        assert list(run_parallel((delayed(abs)(-i) for i in range(9)), 2)) == list(range(9))
        loose = run_parallel((delayed(abs)(-i) for i in range(9)), -1, in_order=False)
    assert sorted(loose) == list(range(9))


def test_calls_run_on_the_cluster_even_one_at_a_time(backend):
    (worker,) = run_parallel([delayed(os.getpid)()], 1, backend=backend)
    assert worker != os.getpid()


def test_what_a_call_raises_is_raised_as_it_is(backend):
    with pytest.raises(InputError, match=r"^gait\.yaml: is refused$"):
        list(run_parallel([delayed(_sent(_refuse))("gait.yaml")], 2, backend=backend))


def test_a_cluster_without_workers_is_given_up(monkeypatch):
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(dask_backend, "WORKERS_AWAITED", 1.0)
    with (
        distributed.LocalCluster(n_workers=0, dashboard_address=None) as cluster,
        distributed.Client(cluster),
        pytest.raises(InputError, match="no worker any more"),
    ):
        list(run_parallel([delayed(abs)(-1)], 1, backend="dask"))


def test_a_call_that_ends_its_worker_again_and_again_is_reported(backend):
    with pytest.raises(InputError, match="worker process"):
        list(run_parallel([delayed(os._exit)(1)], 2, backend=backend))


def test_loops_within_a_worker_stay_in_it_on_one_thread(backend):
    ((inner, worker),) = run_parallel([delayed(_sent(_nested))()], 2, backend=backend)
    assert set(inner) == {worker} != {os.getpid()}
    (n_threads,) = run_parallel([delayed(_sent(_n_threads))()], 2, backend=backend)
    assert set(n_threads) == {1}


def test_signals_stay_this_process_own(backend):
    before = signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT)
    list(run_parallel([delayed(abs)(-1)], 2, backend=backend))
    assert (signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT)) == before


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_calls_end_with_the_process_that_sent_them(number, backend):
    with subprocess.Popen(
        [sys.executable, "-c", PARENT, backend],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as parent:
        workers = {psutil.Process(int(parent.stdout.readline())) for _ in range(6)}
        os.kill(parent.pid, number)
        parent.communicate(timeout=60)
    if backend == "ray":
        _, alive = psutil.wait_procs(workers, timeout=30)
        assert not alive
    else:
        # Dask's workers serve on: the calls that had not begun are forgotten.
        began = time.monotonic()
        list(run_parallel([delayed(abs)(-1) for _ in range(4)], 2, backend=backend))
        assert time.monotonic() - began < 20


class _sent:  # noqa: N801
    """Has a function of this file be sent as a whole: workers cannot import tests."""

    def __init__(self, function):
        self._function = function

    def __reduce__(self):
        import cloudpickle  # noqa: PLC0415

        module = sys.modules[self._function.__module__]
        cloudpickle.register_pickle_by_value(module)
        try:
            return cloudpickle.loads, (cloudpickle.dumps(self._function),)
        finally:
            cloudpickle.unregister_pickle_by_value(module)
