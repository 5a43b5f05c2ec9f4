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
"""Control steps of a window (1 s) over which tracking is averaged: a gait sways in its cycle."""

SCORES = (
    "return",
    "plain_return",
    "rhythm",
    "going_speed_error",
    "yaw_rate_error",
)

PHYSICAL = "fell_physically"
"""Column of scores: whether a robot falls physically, where both kinds of fall are counted."""


def score_rollouts(log: RolloutLog) -> pd.DataFrame:
    """Scores every robot up to its first failure, a row a robot.

    Columns:
        steps: Control steps survived.
        fell: Whether it failed before the end, by any of the task's terminations.
        failure: Names of the terminations.
        return, plain_return: Sums of the rewards with and without the reward machine's factor.
        rhythm: Share of the commanded rhythm that it kept.
        going_speed_error, yaw_rate_error: Means over seconds of the absolute difference between a
            second's average and the command (m/s, rad/s). The first second after a new command is
            left out and, for the speed, seconds in which the robot is commanded to stand: standing
            is easy, and drawn commands below `DEAD_BAND` ask for it. NaN if nothing is left.
    """
    n_steps, n_robots = log.reward.shape
    failed = np.any(log.failures, axis=2)
    rows = []
    for i in range(n_robots):
        # A robot is scored until its first failure; what it does on the ground does not count.
        fell = bool(failed[:, i].any())
        steps = int(np.argmax(failed[:, i])) + 1 if fell else n_steps
        alive = slice(0, steps)
        speed_error, yaw_rate_error = _tracking_errors(
            log.velocity[alive, i], log.command[alive, i]
        )
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
                "yaw_rate_error": yaw_rate_error,
            }
        )
    return pd.DataFrame(rows)


def _tracking_errors(velocity: Array, command: Array) -> tuple[float, float]:
    """Returns the mean errors of speed, where it is commanded, and of yaw rate (m/s, rad/s)."""
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
    known = values.dropna().to_numpy(dtype=float)
    if len(known) < 2:
        return float("nan")
    quantile = stats.t.ppf(0.975, len(known) - 1)
    return float(quantile * np.std(known, ddof=1) / np.sqrt(len(known)))


def wilson_interval(count: int, n: int) -> tuple[float, float]:
    """Returns the 95 % interval of a share, by Wilson's score."""
    bounds = stats.binomtest(count, n).proportion_ci(confidence_level=0.95, method="wilson")
    return float(bounds.low), float(bounds.high)


def summarize(scores: pd.DataFrame, by: Sequence[str], against: str | None = None) -> pd.DataFrame:
    """Averages scores over robots, with falls and intervals.

    A row a group, in the order of the scores: means and half the widths of their 95 % intervals
    (`_ci`); `falls`, their share `fall_rate` with Wilson's interval (`_low`, `_high`) and, if they
    were told apart, `physical_falls`. `against` a policy, robot by robot in the same gait and
    scenario, also `points_more`, by which the falls of a hundred exceed the reference's, and the
    shares of its return (`share`) and plain return (`plain_share`) with paired intervals.
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
    for place in {"gait", "scenario"} & {*scores}:
        reference = reference[reference[place] == group[place].iloc[0]]
    compared = {"points_more": 100.0 * (group["fell"].mean() - reference["fell"].mean())}
    for name, score in {"share": "return", "plain_share": "plain_return"}.items():
        share, half = paired_share(group[score], reference[score])
        compared |= {name: share, f"{name}_ci": half}
    return compared


def paired_share(values: pd.Series, reference: pd.Series) -> tuple[float, float]:
    """Returns the mean of values as a share of a reference's, and half its 95 % interval.

    Robots of a seed start alike, are commanded alike and feel the same noise. They are compared one
    by one, which leaves out how much robots differ by their commands: the interval is that of a
    ratio of paired means, to first order in the errors.
    """
    part, whole = values.to_numpy(dtype=float), reference.to_numpy(dtype=float)
    share = part.mean() / whole.mean()
    return share, interval(pd.Series(part - share * whole)) / abs(whole.mean())
