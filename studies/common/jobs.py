"""Jobs side by side, on this machine or a cluster, and runs of many gaits and seeds."""

import logging
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

from annotated_types import Le, MinLen
from joblib import Parallel, delayed, parallel_config
from joblib.externals.loky.process_executor import TerminatedWorkerError
from joblib.parallel import get_active_backend
from threadpoolctl import threadpool_limits

from glassgait.models.errors import InputError, brief
from glassgait.models.settings import DISTINCT, FEW, Count, Settings, checked
from glassgait.models.task.gait import gait_names, load_gait
from glassgait.studies.common.console import console, say

Steps = Annotated[Count, Le(180_000)]
"""Control steps of one robot: an hour at most, which the memory holds."""

Gaits = Annotated[tuple[str, ...], MinLen(1), FEW, DISTINCT]
"""Names of gaits, or paths of gait files."""

Seeds = Annotated[Count, Le(10_000)]
"""Number of seeds: each is a job, and all jobs are listed before the first."""


@checked
class Workers(Settings):
    """Where jobs run, and how many at once.

    Attributes:
        backend: Where jobs run: in processes of this machine (`loky`), or on a Ray or a Dask
            cluster.
        n_workers: Jobs that run at once; by default as many as there are cores.
    """

    title: ClassVar[str] = "workers"

    backend: Literal["loky", "ray", "dask"] = "loky"
    n_workers: Count | None = None

    @contextmanager
    def pool(self) -> Iterator[None]:
        """Lets the loops within, those of `run_parallel`, run on these workers.

        The cluster is the one that DASK_SCHEDULER_ADDRESS or RAY_ADDRESS names, or else a new one
        of this machine's cores. Its workers must see the run's folder under the same path.
        """
        connect = {"loky": nullcontext, "ray": _connect_to_ray, "dask": _connect_to_dask}
        try:
            connected = connect[self.backend]()
        except ImportError as error:
            remedy = f"run pip install 'glassgait[{self.backend}]'"
            raise InputError(f"--backend {self.backend}: is not installed; {remedy}") from error
        except (OSError, RuntimeError, ValueError) as error:
            problem = f"no cluster answers ({brief(str(error))}); check its address"
            raise InputError(f"--backend {self.backend}: {problem}") from error
        # What surrounds a command may choose another backend than loky.
        backend = {} if self.backend == "loky" else {"backend": self.backend}
        with connected, parallel_config(n_jobs=self.n_workers or -1, **backend):
            yield


def _connect_to_dask() -> Any:
    import dask.config
    import distributed

    if dask.config.get("scheduler-address", None):
        return distributed.Client()
    return distributed.Client(threads_per_worker=1, dashboard_address=None)


def _connect_to_ray() -> Any:
    # Set before Ray is imported: it reports nothing to its makers unless a person asks for it.
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    import ray
    from ray.util.joblib import register_ray

    register_ray()
    return ray.init(log_to_driver=False, logging_level=logging.ERROR, ignore_reinit_error=True)


def run_parallel(calls: Iterable[Any], *, in_order: bool = True) -> Iterator[Any]:
    """Makes calls of `joblib.delayed` on the workers of the surrounding `Workers.pool`.

    Yields results in the order of the calls, or each as soon as it is there. Without a pool, or of
    a single call, it makes them here. An InputError says if a worker process was killed.
    """
    calls = list(calls)
    backend: Any
    backend, n_jobs = get_active_backend()
    n_jobs = min(backend.effective_n_jobs(n_jobs), len(calls))
    if n_jobs <= 1:
        yield from (_call(*call) for call in calls)
        return
    kind = "generator" if in_order else "generator_unordered"
    if not backend.supports_return_generator:
        # Ray returns its results at the end.
        kind = "list"
    try:
        yield from Parallel(n_jobs, return_as=kind)(delayed(_call)(*call) for call in calls)
    except TerminatedWorkerError as error:
        raise InputError(
            "a worker process was ended from outside, most likely for lack of memory; free some or "
            "ask for fewer at once, then continue with --resume"
        ) from error


def _call(function: Callable[..., Any], values: Sequence[Any], named: dict[str, Any]) -> Any:
    # Sums depend on the number of threads: with one, results are the same wherever a call runs.
    with threadpool_limits(1), parallel_config("sequential"):
        return function(*values, **named)


class Job(NamedTuple):
    """A run of one gait, by name or file, and one seed, in a folder by which errors call it."""

    gait: str
    seed: int
    folder: Path


def gaits_named(names: Sequence[str]) -> tuple[str, ...]:
    """Returns gaits as they were named; `all` stands for every gait that ships."""
    return gait_names() if tuple(names) == ("all",) else tuple(names)


def jobs_of(names: Sequence[str], seeds: range, root: Path, output: Path | None) -> list[Job]:
    """Returns a job for each gait and seed.

    The folder that a person named, if any, is that of the only run, or of all in place of `root`.
    """
    gaits = {name: load_gait(name).name for name in gaits_named(names)}
    if output and len(gaits) * len(seeds) == 1:
        return [Job(next(iter(gaits)), seeds[0], output)]
    return [
        Job(name, seed, (output or root) / gait / (f"seed_{seed}" if len(seeds) > 1 else ""))
        for name, gait in gaits.items()
        for seed in seeds
    ]


def run_jobs(jobs: Sequence[Job], run: Callable[[Job], Any]) -> list[Any]:
    """Runs several jobs on the workers by a function that is pickled, and returns their results.

    A single one runs here, and its own loops on the workers. Jobs that are refused are named in an
    InputError after all others are done.
    """
    if len(jobs) == 1:
        return [run(jobs[0])]
    results, refused = [], []
    for job, (result, sentence) in zip(
        jobs, run_parallel(delayed(_run_job)(job, run) for job in jobs), strict=True
    ):
        results.append(result)
        refused += [f"{job.folder}: {sentence}"] if sentence else []
        say(f"{job.folder}: {'refused' if sentence else 'done'} ({len(results)} of {len(jobs)})")
    if refused:
        raise InputError(
            f"{len(refused)} of {len(jobs)} jobs were refused, the others are done: "
            + "; ".join(refused)
        )
    return results


def _run_job(job: Job, run: Callable[[Job], Any]) -> tuple[Any, str]:
    """Returns the result of a job, and the sentence that it was refused with, if it was."""
    # Progress bars of several jobs at once would overwrite one another.
    console.quiet = True
    try:
        return run(job), ""
    except InputError as error:
        return None, str(error)
    finally:
        console.quiet = False
