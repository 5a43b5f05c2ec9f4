"""Parallel jobs, and runs of several gaits and seeds."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple

from annotated_types import Le, MinLen
from joblib import Parallel, delayed, parallel_config
from joblib.externals.loky.process_executor import TerminatedWorkerError
from joblib.parallel import get_active_backend
from threadpoolctl import threadpool_limits

from glassgait.models.errors import InputError
from glassgait.models.settings import DISTINCT, FEW, Count, Settings, checked
from glassgait.models.task.gait import gait_names, load_gait
from glassgait.studies.common.console import console, say

Steps = Annotated[Count, Le(180_000)]
"""Control steps of one robot, at most an hour, which fits in memory."""

Gaits = Annotated[tuple[str, ...], MinLen(1), FEW, DISTINCT]
"""Names of gaits, or paths of gait files."""

Seeds = Annotated[Count, Le(10_000)]
"""Number of seeds, limited since all jobs are listed before the first one runs."""


@checked
class Workers(Settings):
    """Workers that run jobs in parallel.

    Attributes:
        n_workers: Number of jobs that run at once; by default the number of cores.
    """

    title: ClassVar[str] = "workers"

    n_workers: Count | None = None

    @contextmanager
    def pool(self) -> Iterator[None]:
        """Makes calls of `run_parallel` in this context use these workers.

        They are processes of this machine, or of the joblib backend that the caller has selected.
        """
        with parallel_config(n_jobs=self.n_workers or -1):
            yield


def run_parallel(calls: Iterable[Any], *, in_order: bool = True) -> Iterator[Any]:
    """Runs calls of `joblib.delayed` on the workers of the enclosing `Workers.pool`.

    Yields results in the order of the calls, or as soon as they are available. Without a pool, or
    with a single call, runs them in this process. Raises an InputError if a worker was killed.
    """
    calls = list(calls)
    backend: Any
    backend, n_jobs = get_active_backend()
    n_jobs = min(backend.effective_n_jobs(n_jobs), len(calls))
    if n_jobs <= 1:
        yield from (_call(*call) for call in calls)
        return
    return_as = "generator" if in_order else "generator_unordered"
    if not backend.supports_return_generator:
        # Ray returns all results at the end.
        return_as = "list"
    try:
        yield from Parallel(n_jobs, return_as=return_as)(delayed(_call)(*call) for call in calls)
    except TerminatedWorkerError as error:
        raise InputError(
            "a worker process was ended from outside, probably for lack of memory; free memory or "
            "lower --n-workers, then continue with --resume"
        ) from error


def _call(function: Callable[..., Any], args: Sequence[Any], kwargs: dict[str, Any]) -> Any:
    # Sums depend on the number of threads. Always use one, for equal results on all workers.
    with threadpool_limits(1), parallel_config("sequential"):
        return function(*args, **kwargs)


class Job(NamedTuple):
    """A run of one gait (name or file) and one seed in a folder; errors show the folder."""

    gait: str
    seed: int
    folder: Path


def expand_gaits(names: Sequence[str]) -> tuple[str, ...]:
    """Returns the names, with `all` replaced by every built-in gait."""
    return gait_names() if tuple(names) == ("all",) else tuple(names)


def jobs_of(names: Sequence[str], seeds: range, root: Path, output: Path | None) -> list[Job]:
    """Returns a job for each gait and seed.

    `output` is the folder of a single run, or replaces `root` as the folder of several runs.
    """
    gaits = {name: load_gait(name).name for name in expand_gaits(names)}
    if output and len(gaits) * len(seeds) == 1:
        return [Job(next(iter(gaits)), seeds[0], output)]
    return [
        Job(name, seed, (output or root) / gait / (f"seed_{seed}" if len(seeds) > 1 else ""))
        for name, gait in gaits.items()
        for seed in seeds
    ]


def run_jobs(jobs: Sequence[Job], run: Callable[[Job], Any]) -> list[Any]:
    """Runs jobs on the workers with a function that can be pickled, and returns their results.

    A single job runs in this process, and its parallel loops use the workers. An InputError lists
    jobs with bad input after all other jobs are done.
    """
    if len(jobs) == 1:
        return [run(jobs[0])]
    results, refused = [], []
    for job, (result, problem) in zip(
        jobs, run_parallel(delayed(_run_job)(job, run) for job in jobs), strict=True
    ):
        results.append(result)
        refused += [f"{job.folder}: {problem}"] if problem else []
        say(f"{job.folder}: {'refused' if problem else 'done'} ({len(results)} of {len(jobs)})")
    if refused:
        raise InputError(
            f"{len(refused)} of {len(jobs)} jobs were refused, the others are done: "
            + "; ".join(refused)
        )
    return results


def _run_job(job: Job, run: Callable[[Job], Any]) -> tuple[Any, str]:
    """Returns the result of a job and the message of its InputError, if any."""
    # Progress bars of parallel jobs would overwrite each other.
    console.quiet = True
    try:
        return run(job), ""
    except InputError as error:
        return None, str(error)
    finally:
        console.quiet = False
