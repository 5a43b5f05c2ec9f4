"""Commanded against measured speed and yaw rate, of robots that keep one command."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from glassgait.models.arrays import Array
from glassgait.models.task.command import Command
from glassgait.models.task.gait import Gait
from glassgait.studies.common.episode import episode, give
from glassgait.studies.common.observers import Log
from glassgait.studies.common.rollouts.config import RolloutConfig
from glassgait.studies.common.rollouts.jobs import RolloutJob
from glassgait.studies.common.rollouts.scores import interval

SPEEDS = (-0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75)
"""Forward speeds that are commanded (m/s), without turning, as far as the gait goes."""

YAW_RATES = (-0.8, -0.4, 0.4, 0.8)
"""Yaw rates that are commanded (rad/s), at `TURNING_SPEED`."""

TURNING_SPEED = 0.5
"""Forward speed at which yaw rates are commanded (m/s), or the greatest below it."""

N_ROBOTS = 8
"""Robots for each command, at most; their dwells are spread over the gait's range."""

N_STEPS = 500
"""Control steps that a command is kept (10 s), at most."""

SETTLED_SHARE = 0.5
"""Share of the steps, at the end, over which speed and yaw rate are averaged."""

COMMANDED = ["commanded speed (m/s)", "commanded yaw rate (rad/s)"]
MEASURED = ["measured speed (m/s)", "measured yaw rate (rad/s)"]


def steady_commands(gait: Gait, speed_range: tuple[float, float] | None) -> Array:
    """Lists the steady commands of a gait.

    Args:
        gait: The gait; nothing is commanded that is beyond its ranges.
        speed_range: Least and greatest forward speed (m/s); the gait's by default.

    Returns:
        Forward speeds and yaw rates (m, 2; m/s, rad/s): first all speeds, then turns.
    """
    slowest, fastest = speed_range or (-gait.max_speed, gait.max_speed)
    straight = [(speed, 0.0) for speed in SPEEDS if slowest <= speed <= fastest]
    turning = float(np.clip(TURNING_SPEED, slowest, fastest))
    turns = [(turning, rate) for rate in YAW_RATES if abs(rate) <= gait.max_yaw_rate]
    return np.array(straight + turns)


def steady_jobs(jobs: Sequence[RolloutJob], config: RolloutConfig) -> list[RolloutJob]:
    """Lists those rollouts of an evaluation in which `follow` asks for steady commands.

    They are of its first world that has a time step, and of its first seed; of policies that
    alternate there are only those in which one acts alone. Students are asked for all speeds,
    not only for those of distillation.

    Args:
        jobs: The evaluation's rollouts.
        config: Its settings: fewer robots or steps than `N_ROBOTS` and `N_STEPS` are kept, and a
            range of speeds.
    """
    own = replace(
        config,
        n_robots=min(config.n_robots, N_ROBOTS),
        n_steps=min(config.n_steps, N_STEPS),
        n_seeds=1,
    )
    alone = [
        job
        for job in jobs
        if job.config.seed == config.seed
        and job.scenario.accuracy is None
        and job.labels.get("ratio", "0") in ("0", "1")
    ]
    return [replace(job, config=own) for job in alone if job.scenario == alone[0].scenario]


def follow(job: RolloutJob) -> pd.DataFrame:
    """Rolls robots out that keep one command each.

    Returns:
        A row a robot, with the job's labels: `dwell` (control steps), what was commanded, `fell`,
        and the means measured over the last half of the rollout, NaN of a robot that fell.
    """
    gait, n, n_steps = job.gait, job.config.n_robots, job.config.n_steps
    commands = steady_commands(gait, job.config.speed_range)
    command = Command(
        np.repeat(commands, n, axis=0),
        np.tile(np.rint(np.linspace(*gait.dwell, n)), len(commands)),
    )
    recorder = Log(job.policy.robot, limited=job.scenario.limits_targets(job.policy))
    episode(
        gait,
        job.policy,
        job.scenario,
        n_robots=len(command.dwell),
        n_steps=n_steps,
        seed=job.config.seed,
        observers=[recorder],
        events=[give(0, command)],
    )
    log = recorder.rollout(n_steps)
    fell = np.asarray(log.failures.any(axis=(0, 2)))
    measured = log.velocity[-max(1, round(SETTLED_SHARE * n_steps)) :].mean(axis=0)
    measured[fell] = np.nan
    rows = pd.DataFrame(command.velocity, columns=COMMANDED).assign(dwell=command.dwell)
    rows["fell"] = fell
    rows[MEASURED] = measured
    for position, (label, value) in enumerate(job.labels.items()):
        rows.insert(position, label, value)
    return rows


def tracking_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Averages what robots did over those that were told the same.

    Args:
        rows: What `follow` returned of all policies, which the first column tells apart.

    Returns:
        A row a policy and command: means over the robots that did not fall, half the widths of
        their 95 % intervals, and how many fell.
    """
    who = str(rows.columns[0])
    means = []
    for keys, group in rows.groupby([who, *COMMANDED], sort=False):
        row = dict(zip([who, *COMMANDED], keys, strict=True))
        for name in MEASURED:
            row |= {name: group[name].mean(), f"{name.split(' (')[0]} ±": interval(group[name])}
        means.append(row | {"robots": len(group), "falls": int(group["fell"].sum())})
    return pd.DataFrame(means)
