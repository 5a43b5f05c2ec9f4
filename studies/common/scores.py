"""Scores of rollouts, and their means with intervals."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from glassgait.models.arrays import Array
from glassgait.models.task import COMMAND_STEPS, CONTROL_PERIOD
from glassgait.models.task.termination import FAILURES
from glassgait.studies.common.observers import RolloutLog

WINDOW_STEPS = round(1.0 / CONTROL_PERIOD)
"""Control steps of a window (1 s) that averages speeds, since a robot sways in a gait cycle."""

SCORES = ("return", "plain_return", "rhythm", "going_speed_error", "yaw_rate_error")

PHYSICAL = "fell_physically"
"""Column of scores that distinguish physical falls: whether a robot falls physically."""


def score_rollouts(log: RolloutLog) -> pd.DataFrame:
    """Scores every robot up to its first failure, one row per robot.

    Columns:
        steps: Control steps until the first failure or the end.
        fell: Whether the robot failed.
        failure: Names of the failures.
        return, plain_return: Sums of the rewards with and without the reward machine's factor.
        rhythm: Share of the commanded rhythm that was kept.
        going_speed_error, yaw_rate_error: Absolute difference between the average over a second and
            the command (m/s, rad/s), averaged over seconds. The first second after a new command
            does not count. For the speed, seconds with a commanded speed of 0 do not count either,
            since standing is easy (see `DEAD_BAND`). NaN if no second counts.
    """
    n_steps, n_robots = log.reward.shape
    failed = np.any(log.failures, axis=2)
    rows = []
    for i in range(n_robots):
        fell = bool(failed[:, i].any())
        steps = int(np.argmax(failed[:, i])) + 1 if fell else n_steps
        alive = slice(0, steps)
        speed_error, yaw_error = _tracking_errors(log.velocity[alive, i], log.command[alive, i])
        rows.append(
            {
                "robot": i,
                "steps": steps,
                "fell": fell,
                "failure": " ".join(np.array(FAILURES)[log.failures[steps - 1, i]]),
                "return": log.reward[alive, i].sum(),
                "plain_return": log.plain_reward[alive, i].sum(),
                "rhythm": log.served_dwell[alive, i].sum() / steps,
                "going_speed_error": speed_error,
                "yaw_rate_error": yaw_error,
            }
        )
    return pd.DataFrame(rows)


def _tracking_errors(velocity: Array, command: Array) -> tuple[float, float]:
    """Returns the mean errors of speed, if it is commanded, and of yaw rate (m/s, rad/s)."""
    n_windows = len(velocity) // WINDOW_STEPS
    whole = slice(0, n_windows * WINDOW_STEPS)
    difference = (velocity[whole] - command[whole]).reshape(n_windows, WINDOW_STEPS, 2)
    start = np.arange(n_windows) * WINDOW_STEPS
    settled = start % COMMAND_STEPS >= WINDOW_STEPS
    errors = np.abs(difference.mean(axis=1))
    going = settled & (command[start, 0] != 0.0)
    speed, yaw_rate = errors[going, 0], errors[settled, 1]
    return _ratio(speed.sum(), len(speed)), _ratio(yaw_rate.sum(), len(yaw_rate))


def _ratio(part: float, whole: float) -> float:
    return float(part / whole) if whole else float("nan")


def interval(values: pd.Series) -> float:
    """Returns half the width of the 95 % interval of the mean (Student's t)."""
    samples = values.dropna().to_numpy(dtype=float)
    if len(samples) < 2:
        return float("nan")
    quantile = stats.t.ppf(0.975, len(samples) - 1)
    return float(quantile * np.std(samples, ddof=1) / np.sqrt(len(samples)))


def wilson_interval(count: int, n: int) -> tuple[float, float]:
    """Returns the 95 % Wilson score interval of a share."""
    bounds = stats.binomtest(count, n).proportion_ci(confidence_level=0.95, method="wilson")
    return float(bounds.low), float(bounds.high)


def summarize(scores: pd.DataFrame, by: Sequence[str], against: str | None = None) -> pd.DataFrame:
    """Averages scores over the robots of each group, in the order of the scores.

    Columns:
        <score>, <score>_ci: Mean, and half the width of its 95 % interval.
        falls, fall_rate, fall_rate_low, fall_rate_high: Number and share of falls, with the Wilson
            interval.
        physical_falls: Number of physical falls, if the scores distinguish them.
        points_more, share, plain_share: Comparison with the policy `against` in the same gait and
            scenario: difference of the fall rates in percentage points, and share of its return and
            plain return with paired intervals.
    """
    keys, rows = list(by), []
    for values, group in scores.groupby(keys, sort=False):
        falls, n = int(group["fell"].sum()), len(group)
        low, high = wilson_interval(falls, n)
        row: dict[str, Any] = {**dict(zip(keys, values, strict=True)), "robots": n, "falls": falls}
        row |= {"fall_rate": falls / n, "fall_rate_low": low, "fall_rate_high": high}
        if PHYSICAL in group:
            row["physical_falls"] = int(group[PHYSICAL].sum())
        for name in SCORES:
            row |= {name: group[name].mean(), f"{name}_ci": interval(group[name])}
        if against is not None:
            row |= _compared(group, scores, against)
        rows.append(row)
    return pd.DataFrame(rows)


def _compared(group: pd.DataFrame, scores: pd.DataFrame, against: str) -> dict[str, float]:
    """Compares a group with a policy in the same gait and scenario."""
    reference = scores[scores["policy"] == against]
    for column in {"gait", "scenario"} & {*scores}:
        reference = reference[reference[column] == group[column].iloc[0]]
    compared = {"points_more": 100.0 * (group["fell"].mean() - reference["fell"].mean())}
    for name, score in {"share": "return", "plain_share": "plain_return"}.items():
        share, half = paired_share(group[score], reference[score])
        compared |= {name: share, f"{name}_ci": half}
    return compared


def paired_share(values: pd.Series, reference: pd.Series) -> tuple[float, float]:
    """Returns the ratio of the means of values and reference, and half its 95 % interval.

    The robots of a seed have the same starts, commands and noise. Pairing them removes the variance
    between commands: the interval is that of a ratio of paired means, to first order in the errors.
    """
    x, y = values.to_numpy(dtype=float), reference.to_numpy(dtype=float)
    share = x.mean() / y.mean()
    return share, interval(pd.Series(x - share * y)) / abs(y.mean())
