"""Many rollouts: side by side in processes, each kept when it is done."""

import hashlib
import json
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import pandas as pd
from joblib import delayed

from models.a1 import robot
from models.files import write_atomically
from models.task.gait import Gait
from studies.console import progress_bar
from studies.evaluation.config import RolloutConfig, World
from studies.evaluation.rollouts import roll_out
from studies.evaluation.scores import score_rollouts
from studies.evaluation.team import Team
from studies.parallel import run_parallel
from studies.records import to_plain


@dataclass(frozen=True)
class RolloutJob:
    """Robots of one seed to roll out and score.

    Attributes:
        labels: Columns that tell the job's rows from the others'.
        gait: The gait.
        team: Who acts.
        world: Where.
        config: How; its first seed alone counts.
    """

    labels: dict[str, str]
    gait: Gait
    team: Team
    world: World
    config: RolloutConfig

    def __post_init__(self) -> None:
        self.config.refuse_speeds_beyond(self.gait)

    @property
    def name(self) -> str:
        """What progress and files call it."""
        return "_".join([*self.labels.values(), str(self.config.seed)]).replace("/", "-")

    def digest(self) -> str:
        """Tells jobs apart that would not give the same scores."""
        settings = [repr(self.gait), to_plain(self.world), to_plain(self.config)]
        settings.append(self.team.settings())
        digest = hashlib.sha256(json.dumps(settings).encode())
        for policy in (self.team.expert, self.team.student):
            arrays, values = policy.to_arrays() if policy is not None else ({}, {})
            digest.update(json.dumps(values).encode())
            for name in sorted(arrays):
                digest.update(name.encode() + arrays[name].tobytes())
        return digest.hexdigest()[:16]


def for_each_seed(job: RolloutJob) -> list[RolloutJob]:
    """Splits a job into one for each seed."""
    return [
        replace(job, config=replace(job.config, seed=seed, n_seeds=1)) for seed in job.config.seeds
    ]


def run_jobs(
    jobs: Sequence[RolloutJob], folder: Path, *, resume: bool = False, processes: int | None = None
) -> pd.DataFrame:
    """Rolls out and scores every job.

    Args:
        jobs: The jobs, the slowest best first.
        folder: Where each job's scores are kept as soon as it is done.
        resume: Whether to take scores that `folder` already holds, if policies and settings are
            the same.
        processes: Processes to use; as many as there are cores by default.

    Returns:
        Scores, a row a robot, in the order of the jobs, with their labels and the seed.
    """
    paths = [folder / f"{job.name}.{job.digest()}.json" for job in jobs]
    pending = [i for i, path in enumerate(paths) if not (resume and path.exists())]
    processes = min(processes or os.cpu_count() or 1, max(1, len(pending)))
    with progress_bar(len(jobs), len(jobs) - len(pending)) as (progress, bar):
        for i, scores in _finished(jobs, pending, processes):
            # JSON keeps every digit.
            write_atomically(paths[i], json.dumps(scores.to_dict(orient="list")))
            progress.update(bar, advance=1, text=jobs[i].name)
    kept = [pd.DataFrame(json.loads(path.read_text())) for path in paths]
    return pd.concat(kept, ignore_index=True)


def _finished(
    jobs: Sequence[RolloutJob], pending: list[int], processes: int
) -> Iterator[tuple[int, pd.DataFrame]]:
    work = (delayed(_score)(i, jobs[i]) for i in pending)
    yield from run_parallel(work, processes, in_order=False)


def _score(index: int, job: RolloutJob) -> tuple[int, pd.DataFrame]:
    log = roll_out(job.gait, job.team, job.world, job.config)
    scores = score_rollouts(log, robot.MASS + job.world.station.payload)
    for position, (label, value) in enumerate({**job.labels, "seed": job.config.seed}.items()):
        scores.insert(position, label, value)
    return index, scores
