"""Many rollouts: side by side in processes, each kept when it is done."""

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol, TypeVar

import pandas as pd
from joblib import delayed

from glassgait.diagrams.scenario import Scenario
from glassgait.models.files import read_record, write_record
from glassgait.models.policies.controller import Controller
from glassgait.models.task.gait import Gait
from glassgait.studies.common.console import progress_bar, say
from glassgait.studies.common.parallel.loop import run_parallel
from glassgait.studies.common.rollouts.config import RolloutConfig
from glassgait.studies.common.rollouts.roll_out import roll_out
from glassgait.studies.common.rollouts.scores import SCORES, score_rollouts
from glassgait.studies.common.rollouts.seeds import SELECTION_SEEDS, refuse_to_report
from glassgait.studies.common.serialization import to_plain


class Job(Protocol):
    """Work of its own, of which a table comes."""

    @property
    def name(self) -> str:
        """What progress and files call it."""
        ...

    def digest(self) -> str:
        """Tells jobs apart that would not give the same table."""
        ...


J = TypeVar("J", bound=Job)


@dataclass(frozen=True)
class RolloutJob:
    """Robots of one seed to roll out and score.

    Attributes:
        labels: Columns that tell the job's rows from the others'.
        gait: The gait.
        policy: The controller.
        scenario: The world.
        config: How; its first seed alone counts.
    """

    labels: dict[str, str]
    gait: Gait
    policy: Controller
    scenario: Scenario
    config: RolloutConfig

    def __post_init__(self) -> None:
        self.config.refuse_speeds_beyond(self.gait)
        self.config.commanding(self.scenario).command.check(self.gait)

    @property
    def name(self) -> str:
        """What progress and files call it."""
        return "_".join([*self.labels.values(), str(self.config.seed)]).replace("/", "-")

    def digest(self) -> str:
        """Tells jobs apart that would not give the same scores."""
        settings = [self.gait.digest(), self.scenario.digest(), to_plain(self.config), SCORES]
        settings.append(self.policy.settings())
        policies = (self.policy.expert, self.policy.student)
        settings += [policy.digest() for policy in policies if policy is not None]
        return hashlib.sha256(json.dumps(settings).encode()).hexdigest()[:16]


def for_each_seed(job: RolloutJob) -> list[RolloutJob]:
    """Splits a job into one for each seed.

    Raises:
        InputError: if one of the seeds is kept for selection: what it shows is not to be reported.
    """
    refuse_to_report(job.config.seeds)
    return [_with_seed(job, seed) for seed in job.config.seeds]


def for_selection(jobs: Sequence[RolloutJob]) -> list[RolloutJob]:
    """Returns the jobs once each, of whatever seeds they were, with a seed that selects."""
    first = jobs[0].config.seed
    return [_with_seed(job, SELECTION_SEEDS[0]) for job in jobs if job.config.seed == first]


def _with_seed(job: RolloutJob, seed: int) -> RolloutJob:
    return replace(job, config=replace(job.config, seed=seed, n_seeds=1))


def inputs_of(jobs: Sequence[RolloutJob]) -> dict[str, str]:
    """Returns digests of all that the jobs roll out, as a run folder records them."""
    policies = [job.policy for job in jobs]
    digests = {
        "gait": {job.gait.digest() for job in jobs},
        "expert": {policy.expert.digest() for policy in policies},
        "scenario": {job.scenario.digest() for job in jobs},
        "students": {policy.student.digest() for policy in policies if policy.student is not None},
    }
    return {name: " ".join(sorted(own)) for name, own in digests.items()}


def run_jobs(
    jobs: Sequence[RolloutJob], folder: Path, *, processes: int | None = None
) -> pd.DataFrame:
    """Rolls out and scores every job, but for those whose scores the folder holds already.

    Args:
        jobs: The jobs, the slowest best first.
        folder: Where each job's scores are kept as soon as it is done.
        processes: Rollouts at once; by default as many as there are cores, or the cluster has.

    Returns:
        Scores, a row a robot, in the order of the jobs, with their labels and the seed.

    Raises:
        InputError: if scores that the folder holds are damaged.
    """
    return finish_jobs(jobs, _score, folder, processes=processes, tell=_tell_not_finite)


def finish_jobs(
    jobs: Sequence[J],
    do: Callable[[J], pd.DataFrame],
    folder: Path,
    *,
    processes: int | None = None,
    tell: Callable[[J, pd.DataFrame], None] | None = None,
) -> pd.DataFrame:
    """Does every job side by side, but for those whose tables the folder holds already.

    Args:
        jobs: The jobs, the slowest best first.
        do: Does one of them, in whichever process.
        folder: Where each job's table is kept as soon as it is done.
        processes: Jobs at once; by default as many as there are cores, or the cluster has.
        tell: Called with each job that is done and its table.

    Returns:
        The tables, in the order of the jobs.

    Raises:
        InputError: if a table that the folder holds is damaged.
    """
    paths = [folder / f"{job.name}.{job.digest()}.json" for job in jobs]
    kept = {i: read_record(path, of=path.stem) for i, path in enumerate(paths) if path.exists()}
    pending = [i for i in range(len(jobs)) if i not in kept]
    processes = max(1, min(processes or len(pending), len(pending)))
    work = (delayed(_numbered)(i, do, jobs[i]) for i in pending)
    with progress_bar(len(jobs), len(jobs) - len(pending)) as (progress, bar):
        for i, table in run_parallel(work, processes, in_order=False):
            kept[i] = table.to_dict(orient="list")
            write_record(paths[i], kept[i], of=paths[i].stem)
            if tell is not None:
                tell(jobs[i], table)
            progress.update(bar, advance=1, text=jobs[i].name)
    tables = [pd.DataFrame(kept[i]) for i in range(len(jobs))]
    return pd.concat(tables, ignore_index=True)


def _numbered(index: int, do: Callable[[J], pd.DataFrame], job: J) -> tuple[int, pd.DataFrame]:
    return index, do(job)


def _tell_not_finite(job: RolloutJob, scores: pd.DataFrame) -> None:
    """Says where a policy gave no action: among the falls, it would look like any other."""
    lost = scores[scores["not_finite"] != ""]
    if len(lost):
        first = lost.sort_values("steps").iloc[0]
        say(
            f"{job.name}: the action of {first['not_finite']} is not finite at control step "
            f"{first['steps'] - 1}, robot {first['robot']}; so it is for {len(lost)} of "
            f"{len(scores)} robots, which count as fallen"
        )


def _score(job: RolloutJob) -> pd.DataFrame:
    log = roll_out(job.gait, job.policy, job.scenario, job.config)
    scores = score_rollouts(log, job.policy.robot.mass + job.scenario.station.payload)
    for position, (label, value) in enumerate({**job.labels, "seed": job.config.seed}.items()):
        scores.insert(position, label, value)
    return scores
