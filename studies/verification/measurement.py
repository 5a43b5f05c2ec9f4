"""Measuring the operating box: what robots sense in all worlds while they do not fall."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from joblib import delayed

from glassgait.diagrams.scenario import Scenario
from glassgait.models.arrays import Array
from glassgait.models.certificates.box import MARGIN, ObservationBox, measured_box
from glassgait.models.errors import InputError
from glassgait.models.policies.controller import alone
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.task.gait import Gait
from glassgait.studies.common.cases import Case, cases_in_worlds
from glassgait.studies.common.console import progress_bar
from glassgait.studies.common.episode import episode
from glassgait.studies.common.observers import Observations
from glassgait.studies.common.parallel.loop import run_parallel
from glassgait.studies.common.rollouts import RolloutConfig


def measure_box(
    gait: Gait,
    expert: NeuralPolicy,
    students: Mapping[str, Policy],
    scenarios: Mapping[str, Scenario],
    config: RolloutConfig,
    *,
    processes: int | None = None,
) -> tuple[ObservationBox, str]:
    """Rolls out the expert and the students alone in every world, and bounds what robots sense.

    A robot that falls counts no more: what it senses while it falls is no operation. Worlds of
    continuous plants, whose diagrams take minutes a robot, are left out.

    Args:
        gait: The gait.
        expert: The expert; its estimator observes for all.
        students: The students by kind.
        scenarios: The worlds by name.
        config: How robots are rolled out, in each world with each policy.
        processes: Rollouts at once; by default as many as there are cores.

    Returns:
        The operating box, and in words how it was measured.

    Raises:
        InputError: if no robot stayed up.
    """
    stepped = {name: world for name, world in scenarios.items() if world.accuracy is None}
    jobs = cases_in_worlds(
        gait,
        {"expert": alone(expert)} | {kind: alone(own, expert) for kind, own in students.items()},
        stepped,
        config,
    )
    found = [corners for corners in _corners(jobs, processes) if corners is not None]
    if not found:
        raise InputError(f"every robot of the {gait.name} fell; measure with more or longer")
    lower, upper = (np.array(corners) for corners in zip(*found, strict=True))
    names = expert.observation_names
    box = measured_box(gait, expert.robot, names, lower.min(axis=0), upper.max(axis=0))
    measured = (
        f"{gait.name}: what {config.n_robots} robots a scenario sensed in {config.n_steps} control "
        f"steps without a fall, in each of {len(stepped)} scenarios, led by the expert and each of "
        f"{', '.join(students)} (seed {config.seed}); each range widened by {MARGIN:.0%} of its "
        "width on both sides; commands, counts and machine state at their true ranges"
    )
    return box, measured


def _corners(jobs: Sequence[Case], processes: int | None) -> Iterator[tuple[Array, Array] | None]:
    work = (delayed(_sensed)(job) for job in jobs)
    with progress_bar(len(jobs)) as (progress, bar):
        for corners in run_parallel(work, processes or len(jobs), in_order=False):
            progress.update(bar, advance=1)
            yield corners


def _sensed(job: Case) -> tuple[Array, Array] | None:
    """Returns the least and greatest observations (n, n) of the robots that stay up."""
    scenario, observations = job.config.commanding(job.scenario), Observations()
    ended = episode(
        job.gait,
        job.controller,
        scenario,
        n_robots=job.config.robots_in(scenario),
        n_steps=job.config.n_steps,
        seed=job.config.seed,
        observers=[observations],
    )
    up = ended.fell == job.config.n_steps
    if not up.any():
        return None
    kept = observations.array[:, up]
    return kept.min(axis=(0, 1)), kept.max(axis=(0, 1))
