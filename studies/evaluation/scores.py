"""Scores of rollouts, and their means with intervals."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

from models.a1.robot import Array
from models.task import COMMAND_STEPS, CONTROL_PERIOD
from models.task.termination import FAILURES

WINDOW_STEPS = round(1.0 / CONTROL_PERIOD)
"""Tracking is judged by averages over 1 s, since a gait sways within its cycle."""

SCORES = ("reward", "plain_reward", "rhythm", "speed_error", "yaw_rate_error")


@dataclass(frozen=True)
class RolloutLog:
    """What rollouts of n robots over T control steps did.

    Attributes:
        velocity: Forward speed and yaw rate in the trunk's frame (T, n, 2; m/s, rad/s).
        command: Commanded ones (T, n, 2).
        reward: Reward with the machine's factor (T, n).
        plain_reward: Reward without it (T, n).
        served_dwell: Control steps of rhythm served by transitions (T, n).
        failures: Flags in the order of `FAILURES` (T, n, 6).
    """

    velocity: Array
    command: Array
    reward: Array
    plain_reward: Array
    served_dwell: Array
    failures: NDArray[np.bool_]


def score_rollouts(log: RolloutLog) -> pd.DataFrame:
    """Scores every robot up to its first failure.

    Columns: `steps` survived; `fell`, whether it failed before the end, by any of the task's
    terminations; `failure`, their names; `reward` and `plain_reward`, sums; `rhythm`, the share of
    the commanded rhythm kept; `speed_error` (m/s) and `yaw_rate_error` (rad/s), means over seconds
    of the absolute difference between a second's average and the command. The first second after a
    new command is left out.
    """
    n_steps, n_robots = log.reward.shape
    failed = np.any(log.failures, axis=2)
    rows = []
    for robot in range(n_robots):
        fell = bool(failed[:, robot].any())
        steps = int(np.argmax(failed[:, robot])) + 1 if fell else n_steps
        alive = slice(0, steps)
        shown = log.failures[steps - 1, robot]
        errors = _tracking_errors(log.velocity[alive, robot], log.command[alive, robot])
        rows.append(
            {
                "robot": robot,
                "steps": steps,
                "fell": fell,
                "failure": " ".join(np.array(FAILURES)[shown]),
                "reward": log.reward[alive, robot].sum(),
                "plain_reward": log.plain_reward[alive, robot].sum(),
                "rhythm": log.served_dwell[alive, robot].sum() / steps,
                "speed_error": errors[0],
                "yaw_rate_error": errors[1],
            }
        )
    return pd.DataFrame(rows)


def _tracking_errors(velocity: Array, command: Array) -> Array:
    n_windows = len(velocity) // WINDOW_STEPS
    whole = slice(0, n_windows * WINDOW_STEPS)
    difference = (velocity[whole] - command[whole]).reshape(n_windows, WINDOW_STEPS, 2)
    start = np.arange(n_windows) * WINDOW_STEPS
    settled = start % COMMAND_STEPS >= WINDOW_STEPS
    if not settled.any():
        return np.full(2, np.nan)
    return np.abs(difference[settled].mean(axis=1)).mean(axis=0)


def interval(values: pd.Series) -> float:
    """Returns half the width of the 95 % interval of the mean (Student's t)."""
    known = values.dropna().to_numpy(dtype=float)
    if len(known) < 2:
        return float("nan")
    quantile = stats.t.ppf(0.975, len(known) - 1)
    return float(quantile * np.std(known, ddof=1) / np.sqrt(len(known)))


def summarize(scores: pd.DataFrame, by: list[str]) -> pd.DataFrame:
    """Averages scores over robots: means, 95 % intervals (`_ci`), falls and fall rate."""
    rows = []
    for keys, group in scores.groupby(by, sort=False):
        row = dict(zip(by, keys, strict=True))
        row |= {"robots": len(group), "falls": int(group["fell"].sum())}
        row["fall_rate"] = row["falls"] / row["robots"]
        for name in SCORES:
            row[name] = group[name].mean()
            row[f"{name}_ci"] = interval(group[name])
        rows.append(row)
    return pd.DataFrame(rows)
