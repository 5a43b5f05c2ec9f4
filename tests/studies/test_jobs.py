"""Loops in other processes and on clusters, and runs of several gaits and seeds."""

import os
from operator import mul
from pathlib import Path

import pytest
from joblib import Parallel, delayed, parallel_config
from threadpoolctl import threadpool_info

from glassgait.models.errors import InputError
from glassgait.studies.common.jobs import Workers, expand_gaits, jobs_of, run_jobs, run_parallel


def test_results_come_in_the_order_of_the_calls():
    assert list(run_parallel(delayed(mul)(i, 2) for i in range(5))) == [0, 2, 4, 6, 8]


@pytest.mark.slow
def test_calls_run_in_other_processes_on_one_thread_each():
    def where(_=None):
        inner = Parallel(2)(delayed(os.getpid)() for _ in range(2))
        threads = max((own["num_threads"] for own in threadpool_info()), default=1)
        return os.getpid(), inner, threads

    with parallel_config("loky"), Workers(n_workers=2).pool():
        found = list(run_parallel((delayed(where)(i) for i in range(4)), in_order=False))
        (alone,) = run_parallel([delayed(where)()])
    for own, inner, threads in found:
        assert own != os.getpid() and inner == [own, own] and threads == 1
    assert alone[0] == os.getpid()


@pytest.mark.slow
def test_a_worker_that_is_killed_is_reported():
    with parallel_config("loky", n_jobs=2), pytest.raises(InputError, match="ended from outside"):
        list(run_parallel([delayed(os._exit)(1)] * 2))


@pytest.mark.slow
def test_jobs_run_on_the_callers_cluster(tmp_path):
    distributed = pytest.importorskip("distributed")
    client = distributed.Client(n_workers=2, threads_per_worker=1, dashboard_address=None)

    def write(job):
        (tmp_path / f"{job.gait} {job.seed}").touch()
        return os.getpid()

    jobs = jobs_of(("trot", "walk"), range(2), Path("runs"), None)
    with client, parallel_config("dask"), Workers(n_workers=2).pool():
        processes = run_jobs(jobs, write)
    assert os.getpid() not in processes
    written = sorted(path.name for path in tmp_path.iterdir())
    assert written == ["trot 0", "trot 1", "walk 0", "walk 1"]


def folders(names, n_seeds=1, output=None):
    jobs = jobs_of(names, range(3, 3 + n_seeds), Path("runs/train"), output)
    return [str(job.folder) for job in jobs]


def test_each_gait_and_seed_has_its_folder():
    assert folders(["trot"]) == ["runs/train/trot"]
    assert folders(["trot"], output=Path("mine")) == ["mine"]
    assert folders(["trot", "walk"], output=Path("mine")) == ["mine/trot", "mine/walk"]
    assert folders(["trot"], 2) == ["runs/train/trot/seed_3", "runs/train/trot/seed_4"]
    assert len(expand_gaits(["all"])) == 6


def test_a_job_that_is_refused_stops_no_other(capsys):
    def run(job):
        if job.gait == "walk":
            raise InputError("the walk: is refused")
        return job.seed

    jobs = jobs_of(("walk", "trot"), range(2), Path("runs"), None)
    with pytest.raises(InputError, match=r"2 of 4 jobs were refused.*walk/seed_0: the walk"):
        run_jobs(jobs, run)
    assert "trot/seed_1: done (4 of 4)" in " ".join(capsys.readouterr().out.split())
    assert run_jobs(jobs[2:], run) == [0, 1]
