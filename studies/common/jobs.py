"""Jobs side by side: loops in other processes or on a cluster, and runs of many gaits and seeds."""

import logging
import os
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

from annotated_types import Le, Lt, MinLen
from joblib import Parallel, delayed, parallel_config
from joblib.externals.loky.process_executor import TerminatedWorkerError
from joblib.parallel import SequentialBackend, get_active_backend
from pydantic import AfterValidator
from threadpoolctl import threadpool_limits

from glassgait.models.errors import InputError, brief
from glassgait.models.settings import DISTINCT, FEW, Count, Settings, checked
from glassgait.models.task.gait import gait_names, load_gait
from glassgait.studies.common.console import console, say

Backend = Literal["loky", "ray", "dask"]


def _all_or_some(n_jobs: int) -> int:
    if n_jobs < 1 and n_jobs != -1:
        raise ValueError("1 or more, or -1 for as many as there are cores")
    return n_jobs


Jobs = Annotated[int, Lt(2**31), AfterValidator(_all_or_some)]
"""Number of jobs at once, as joblib counts."""


def run_parallel(
    work: Iterable[Any], n_jobs: int = -1, *, in_order: bool = True
) -> Generator[Any, None, None]:
    """Makes calls of `joblib.delayed` in other processes, and yields their results.

    Results come in the order of the calls, or each as soon as it is there. An InputError says if a
    worker process was killed.
    """
    active: Any = get_active_backend()[0]
    kind = "generator" if in_order else "generator_unordered"
    if not (isinstance(active, SequentialBackend) or active.supports_return_generator):
        # Ray returns its results at the end.
        kind = "list"
    try:
        yield from Parallel(n_jobs, return_as=kind)(delayed(_call)(*call) for call in work)
    except TerminatedWorkerError as error:
        raise InputError(
            "a worker process was ended from outside, most likely for lack of memory; free some or "
            "ask for fewer at once, then continue with --resume"
        ) from error


def _call(function: Callable[..., Any], values: Sequence[Any], named: Mapping[str, Any]) -> Any:
    # Sums depend on the number of threads: with one, results are the same wherever a call runs.
    with threadpool_limits(1), parallel_config("sequential"):
        return function(*values, **named)


@contextmanager
def parallel_backend(backend: Backend) -> Iterator[None]:
    """Runs the loops within on this machine, or on a cluster.

    The cluster is the one that DASK_SCHEDULER_ADDRESS or RAY_ADDRESS names, or else a new one of
    this machine's cores. Its workers must see the run's folder under the same path.
    """
    if backend == "loky":
        yield
        return
    try:
        connected = _dask_client() if backend == "dask" else _ray_cluster()
    except ImportError as error:
        raise InputError(
            f"--backend {backend}: is not installed; run pip install 'glassgait[{backend}]'"
        ) from error
    except (OSError, RuntimeError, ValueError) as error:
        raise InputError(
            f"--backend {backend}: no cluster answers ({brief(str(error))})"
        ) from error
    with connected, parallel_config(backend):
        yield


def _dask_client() -> Any:
    import dask.config
    import distributed

    if dask.config.get("scheduler-address", None):
        return distributed.Client()
    return distributed.Client(threads_per_worker=1, dashboard_address=None)


def _ray_cluster() -> Any:
    # Set before Ray is imported: it reports nothing to its makers unless a person asks for it.
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    import ray
    from ray.util.joblib import register_ray

    register_ray()
    return ray.init(log_to_driver=False, logging_level=logging.ERROR, ignore_reinit_error=True)


Gaits = Annotated[tuple[str, ...], MinLen(1), FEW, DISTINCT]
"""Names of gaits, or paths of gait files."""

Seeds = Annotated[Count, Le(10_000)]
"""Number of seeds: each is a job, and all jobs are listed before the first."""


@checked
class WorkersConfig(Settings):
    """Where jobs run, and how many at once.

    Attributes:
        backend: Where jobs run: in processes of this machine (`loky`), or on a Ray or a Dask
            cluster.
        n_workers: Jobs that run at once; -1 for as many as there are cores.
    """

    title: ClassVar[str] = "workers"

    backend: Backend = "loky"
    n_workers: Jobs = -1


@checked
class SweepConfig(WorkersConfig):
    """Number of seeds, and where their jobs run.

    Attributes:
        n_seeds: Number of seeds of each gait: seed, seed + 1, …
    """

    title: ClassVar[str] = "sweep"

    n_seeds: Seeds = 1


class Job(NamedTuple):
    """A run of one gait, by name or file, and one seed; errors call it by its title."""

    gait: str
    seed: int
    folder: Path
    title: str


def gaits_named(names: Sequence[str]) -> tuple[str, ...]:
    """Returns gaits as they were named; `all` stands for every gait that ships."""
    return gait_names() if tuple(names) == ("all",) else tuple(names)


def jobs_of(
    names: Sequence[str], first_seed: int, config: SweepConfig, *, root: Path, output: Path | None
) -> list[Job]:
    """Returns a job for each gait and seed.

    Args:
        root: Folder of the study's runs.
        output: The folder that a person named: that of the only run, or of all.
    """
    seeds = range(first_seed, first_seed + config.n_seeds)
    jobs = []
    for name in gaits_named(names):
        gait = load_gait(name).name
        for seed in seeds:
            folder = (output or root) / gait / (f"seed_{seed}" if len(seeds) > 1 else "")
            jobs.append(Job(name, seed, folder, f"{gait}, seed {seed}"))
    return [jobs[0]._replace(folder=output)] if output and len(jobs) == 1 else jobs


def run_sweep(jobs: Sequence[Job], run: Callable[[Job], Any], config: WorkersConfig) -> list[Any]:
    """Runs every job by a function that is pickled, and returns their results.

    Jobs that are refused are named in an InputError after all others are done.
    """
    results: dict[int, Any] = {}
    refused: list[str] = []
    with parallel_backend(config.backend):
        work = (delayed(_run_job)(place, job, run) for place, job in enumerate(jobs))
        n_jobs = min(config.n_workers, len(jobs))
        for place, result, sentence in run_parallel(work, n_jobs, in_order=False):
            results[place], job = result, jobs[place]
            if sentence is not None:
                refused.append(f"{job.title}: {sentence}")
            ending = "done" if sentence is None else "refused"
            say(f"{job.title}: {ending} ({len(results)} of {len(jobs)}), in {job.folder}")
    if refused:
        raise InputError(
            f"{len(refused)} of {len(jobs)} jobs were refused, the others are done: "
            + "; ".join(sorted(refused))
        )
    return [results[place] for place in range(len(jobs))]


def _run_job(place: int, job: Job, run: Callable[[Job], Any]) -> tuple[int, Any, str | None]:
    """Returns the job's place and its result, or the sentence that it was refused with."""
    # Progress bars of several jobs at once would overwrite one another.
    console.quiet = True
    try:
        return place, run(job), None
    except InputError as error:
        return place, None, str(error)
    finally:
        console.quiet = False
