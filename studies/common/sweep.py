"""Several gaits and seeds in one command: a job each, side by side, in a folder of its own."""

import os
import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

from annotated_types import Le, MinLen
from filelock import FileLock, Timeout
from joblib import delayed
from threadpoolctl import threadpool_limits

from glassgait.models.errors import InputError
from glassgait.models.policies.library import find_gait
from glassgait.models.settings import DISTINCT, FEW, Count, Settings, checked
from glassgait.models.task.gait import gait_names, load_gait
from glassgait.studies.common.console import console, say
from glassgait.studies.common.exit_codes import sentence_of
from glassgait.studies.common.parallel.loop import Backend, Jobs, run_parallel
from glassgait.studies.common.run_folder import LOCK_NAME, refuse_to_start

ALL_GAITS = "all"

Gaits = Annotated[tuple[str, ...], MinLen(1), FEW, DISTINCT]
"""Names of gaits, or paths of gait files."""

Seeds = Annotated[Count, Le(10_000)]
"""How many seeds: each is a job, and all jobs are listed before the first."""

LOCK_PATIENCE = 60.0
"""Seconds that a job waits for the one before it, whose node was lost, to let go of its folder."""


@checked
class WorkersConfig(Settings):
    """Where jobs run, and how many at once.

    Attributes:
        backend: Where jobs run: in processes of this machine (`loky`), or on a Ray or a Dask
            cluster, which does a job again whose node is lost.
        n_workers: Jobs that run at once; -1 for as many as there are cores.
    """

    title: ClassVar[str] = "workers"

    backend: Backend = "loky"
    n_workers: Jobs = -1

    @property
    def processes(self) -> int | None:
        """Jobs that run at once; None for as many as there are cores."""
        return None if self.n_workers < 0 else self.n_workers


@checked
class SweepConfig(WorkersConfig):
    """How many seeds, and where their jobs run.

    Attributes:
        n_seeds: Number of seeds of each gait: seed, seed + 1, …
    """

    title: ClassVar[str] = "sweep"

    n_seeds: Seeds = 1


@dataclass(frozen=True)
class Job:
    """One gait and seed.

    Attributes:
        gait: Name of the gait, or path of its file.
        seed: The seed.
        folder: The run's folder.
        title: What progress calls it.
    """

    gait: str
    seed: int
    folder: Path
    title: str


def gaits_named(names: Sequence[str]) -> tuple[str, ...]:
    """Returns gaits as they were named; `all` stands for every gait that ships.

    Raises:
        InputError: if there is no such gait, `all` stands among others, or two are called the same.
    """
    if ALL_GAITS not in names:
        called = [find_gait(name).name for name in names]
        twice = [name for name in called if called.count(name) > 1]
        if twice:
            raise InputError(f"--gait: two gaits are called {twice[0]}; name one of them")
        return tuple(names)
    if len(names) > 1:
        raise InputError("--gait: 'all' stands for every gait; leave the others out")
    return gait_names()


def jobs_of(
    names: Sequence[str], first_seed: int, config: SweepConfig, *, root: Path, output: Path | None
) -> list[Job]:
    """Returns a job for each gait and seed.

    Args:
        names: Names of gaits, or paths of gait files.
        first_seed: The first seed.
        config: How many seeds.
        root: Folder of the study's runs.
        output: The folder that a person named: that of the only run, or of all.

    Raises:
        InputError: if there is no such gait, `all` stands among others, or two are called the same.
    """
    seeds = range(first_seed, first_seed + config.n_seeds)
    pairs = [(name, seed) for name in gaits_named(names) for seed in seeds]
    jobs = []
    for name, seed in pairs:
        gait = load_gait(name).name
        parts = [gait, f"seed_{seed}"] if len(seeds) > 1 else [gait]
        folder = folder_of(parts, root=root, output=output, alone=len(pairs) == 1)
        jobs.append(Job(name, seed, folder, f"{gait}, seed {seed}"))
    return jobs


def folder_of(parts: Sequence[str], *, root: Path, output: Path | None, alone: bool) -> Path:
    """Returns the folder of a run.

    Args:
        parts: Names of the folders that it is in, below the others.
        root: Folder of the study's runs.
        output: The folder that a person named: that of the only run, or of all.
        alone: Whether it is the only run.
    """
    if alone and output is not None:
        return output
    return (output or root).joinpath(*parts)


def refuse_taken(jobs: Sequence[Job], *, study: str, resume: bool) -> None:
    """Refuses jobs whose folders cannot be claimed, before any is begun.

    Raises:
        InputError: as `refuse_to_start`.
    """
    for job in jobs:
        refuse_to_start(job.folder, study=study, resume=resume)


def run_sweep(jobs: Sequence[Job], run: Callable[[Job], Any], config: WorkersConfig) -> list[Any]:
    """Runs every job; one that is refused stops no other.

    Args:
        jobs: The jobs.
        run: Does a job, from where its folder's run stopped; it is pickled.
        config: Where they run, and how many at once.

    Returns:
        What the jobs returned, in their order.

    Raises:
        InputError: if a worker was killed or, after all other jobs are done, jobs were refused.
    """
    results: dict[int, Any] = {}
    refused: list[str] = []
    with _folders(jobs):
        home = Path.cwd()
        work = (delayed(_run_job)(place, job, run, home) for place, job in _reported(jobs))
        n_jobs = min(config.n_workers, len(jobs))
        ended = run_parallel(work, n_jobs, in_order=False, backend=config.backend, ahead=1)
        # Closed at once on a signal, so that workers end before this process says that it does.
        with closing(ended):
            for place, result, sentence in ended:
                done = f"({len(results) + len(refused) + 1} of {len(jobs)})"
                if sentence is None:
                    results[place] = result
                    say(f"{jobs[place].title}: done {done}, in {jobs[place].folder}")
                else:
                    refused.append(f"{jobs[place].title}: {sentence}")
                    say(f"{jobs[place].title}: refused {done}")
    raise_refused(sorted(refused), len(jobs))
    console.print(f"{len(jobs)} jobs are done")
    return [results[place] for place in range(len(jobs))]


def run_each(names: Sequence[str], run: Callable[[str], Any]) -> None:
    """Runs a study of each gait, one after the other; one that is refused stops no other.

    Args:
        names: Names of gaits, or paths of gait files.
        run: Runs the study of one.

    Raises:
        InputError: after all others are done, if gaits were refused.
    """
    refused = []
    for name in names:
        try:
            run(name)
        except InputError as error:
            say(f"{name}: refused")
            refused.append(f"{name}: {error}")
    raise_refused(refused, len(names))


def raise_refused(sentences: Sequence[str], n_jobs: int) -> None:
    """Raises an error that names the refused jobs, once the others are done.

    Raises:
        InputError: if there are any.
    """
    if sentences:
        raise InputError(
            f"{len(sentences)} of {n_jobs} jobs were refused, the others are done: "
            + "; ".join(sentences)
        )


def _reported(jobs: Sequence[Job]) -> Iterator[tuple[int, Job]]:
    """Reports each job when it is sent."""
    for place, job in enumerate(jobs):
        say(f"{job.title}: sent to a worker")
        yield place, job


@contextmanager
def _folders(jobs: Sequence[Job]) -> Iterator[None]:
    """Makes every job's folder, by which its worker knows that it sees this machine's files."""
    for job in jobs:
        job.folder.mkdir(parents=True, exist_ok=True)
    try:
        yield
    finally:
        for job in jobs:
            # Only an empty folder can be removed: what a job made is kept.
            with suppress(OSError):
                job.folder.rmdir()


def _run_job(
    place: int, job: Job, run: Callable[[Job], Any], home: Path
) -> tuple[int, Any, str | None]:
    """Returns the job's place and result, or the sentence that it was refused with."""
    try:
        _enter(home, job.folder)
        _await_lock(job.folder)
        # A worker is one of many: none takes its siblings' cores, so that where a job runs, and
        # beside how many, changes no bit of its results.
        with _silence(), threadpool_limits(1):
            return place, run(job), None
    except Exception as error:
        sentence = sentence_of(error)
        if sentence is None:
            raise
        return place, None, sentence


def _enter(home: Path, folder: Path) -> None:
    """Goes where the command was given: paths are relative to it.

    Raises:
        InputError: if this machine does not see its files.
    """
    with suppress(OSError):
        os.chdir(home)
    if Path.cwd() != home or not folder.is_dir():
        raise InputError(
            f"{home / folder}: is not seen by the worker on {socket.gethostname()}; run in a "
            "folder that all nodes share under the same path"
        )


def _await_lock(folder: Path) -> None:
    for path in folder.rglob(LOCK_NAME):
        # Where it is still held then, the run reports it itself.
        with suppress(Timeout), FileLock(path, timeout=LOCK_PATIENCE):
            pass


@contextmanager
def _silence() -> Iterator[None]:
    """Leaves the terminal to the command's lines of progress."""
    before, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = before
