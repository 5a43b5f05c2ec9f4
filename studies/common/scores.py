"""Scores of rollouts, and their means with intervals."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from glassgait.models.arrays import Array
from glassgait.models.policies.policy import first_not_finite
from glassgait.models.robots import quadruped
from glassgait.models.task import COMMAND_STEPS, CONTROL_PERIOD
from glassgait.models.task.termination import FAILURES
from glassgait.studies.common.observers import RolloutLog

WINDOW_STEPS = round(1.0 / CONTROL_PERIOD)
"""Tracking is judged by averages over 1 s, since a gait sways within its cycle."""

SCORES = (
    "return",
    "plain_return",
    "rhythm",
    "going_speed_error",
    "yaw_rate_error",
    "way",
    "cost_of_transport",
)

PHYSICAL = "fell_physically"
"""Column of scores: whether a robot falls physically, where both kinds of fall are counted."""

SPEED_ERROR_TITLE = "speed error, commanded to go (m/s)"
"""What tables call `going_speed_error`: commands to stand are left out."""

GRAVITY = 9.81
"""Acceleration by which energy is made comparable (m/s²)."""


def score_rollouts(log: RolloutLog, mass: float) -> pd.DataFrame:
    """Scores every robot up to its first failure.

    Columns: `steps` survived; `fell`, whether it failed before the end, by any of the task's
    terminations; `failure`, their names; `not_finite`, the joint whose action was not finite, if
    there was one; `return` and `plain_return`, sums; `rhythm`, the share of
    the commanded rhythm kept; `going_speed_error` (m/s) and `yaw_rate_error` (rad/s), means over
    seconds of the absolute difference between a second's average and the command. The first second
    after a new command is left out; of the speed, all seconds in which it is commanded to stand
    are, since standing is easy and drawn commands below `DEAD_BAND` ask for it: NaN for a robot
    that is never commanded to go. `way`, the share of the commanded way that it goes, of the steps
    that are commanded to go. `expert_share`, the share of steps at which the expert acted.
    `cost_of_transport`, the joints' absolute work per weight and distance,
    of the steps that are commanded to go forward or back.

    Args:
        log: What the robots did.
        mass: The robot's mass, with its load (kg).
    """
    n_steps, n_robots = log.reward.shape
    failed = np.any(log.failures, axis=2)
    rows = []
    for i in range(n_robots):
        fell = bool(failed[:, i].any())
        steps = int(np.argmax(failed[:, i])) + 1 if fell else n_steps
        alive = slice(0, steps)
        shown = log.failures[steps - 1, i]
        velocity, command = log.velocity[alive, i], log.command[alive, i]
        not_finite = first_not_finite(log.action[alive, i])
        errors = _tracking_errors(velocity, command)
        rows.append(
            {
                "robot": i,
                "steps": steps,
                "fell": fell,
                "failure": " ".join(np.array(FAILURES)[shown]),
                "not_finite": quadruped.JOINTS[not_finite[1]] if not_finite else "",
                "return": log.reward[alive, i].sum(),
                "plain_return": log.plain_reward[alive, i].sum(),
                "rhythm": log.served_dwell[alive, i].sum() / steps,
                "expert_share": log.expert_acts[alive, i].mean(),
                "going_speed_error": errors[0],
                "yaw_rate_error": errors[1],
                "way": _share_of_way(velocity[:, 0], command[:, 0]),
                "cost_of_transport": _cost_of_transport(
                    log.power[alive, i], velocity[:, 0], command[:, 0], mass
                ),
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
    return _mean(errors[going, 0]), _mean(errors[settled, 1])


def _mean(values: Array) -> float:
    return float(values.mean()) if len(values) else float("nan")


def _share_of_way(speed: Array, command: Array) -> float:
    going = command != 0.0
    if not going.any():
        return float("nan")
    return float((speed * np.sign(command))[going].sum() / np.abs(command[going]).sum())


def _cost_of_transport(power: Array, speed: Array, command: Array, mass: float) -> float:
    going = command != 0.0
    distance = np.abs(speed[going]).sum()
    if distance == 0.0:
        return float("nan")
    return float(power[going].sum() / (mass * GRAVITY * distance))


def interval(values: pd.Series) -> float:
    """Returns half the width of the 95 % interval of the mean (Student's t)."""
    known = values.dropna().to_numpy(dtype=float)
    if len(known) < 2:
        return float("nan")
    quantile = stats.t.ppf(0.975, len(known) - 1)
    return float(quantile * np.std(known, ddof=1) / np.sqrt(len(known)))


def summarize(scores: pd.DataFrame, by: list[str]) -> pd.DataFrame:
    """Averages scores over robots: means, 95 % intervals (`_ci`), falls and fall rate.

    Where scores count physical falls, too, `physical_falls` is how many there are.
    """
    rows = []
    for keys, group in scores.groupby(by, sort=False):
        row: dict[str, Any] = dict(zip(by, keys, strict=True))
        row |= {"robots": len(group), "falls": int(group["fell"].sum())}
        row["fall_rate"] = row["falls"] / row["robots"]
        if PHYSICAL in group:
            row["physical_falls"] = int(group[PHYSICAL].sum())
        for name in SCORES:
            row[name] = group[name].mean()
            row[f"{name}_ci"] = interval(group[name])
        rows.append(row)
    return pd.DataFrame(rows)


def summarize_against(scores: pd.DataFrame, by: list[str], reference: pd.DataFrame) -> pd.DataFrame:
    """Averages scores over robots, with shares of a reference's return.

    Args:
        scores: Scores, a row a robot.
        by: Columns whose values make a group.
        reference: Scores of the reference, as `return_shares` takes them.

    Returns:
        What `summarize` returns, with the columns of `return_shares`.
    """
    return summarize(scores, by).merge(return_shares(scores, by, reference), on=by)


def return_shares(scores: pd.DataFrame, by: list[str], reference: pd.DataFrame) -> pd.DataFrame:
    """Sets returns in proportion to those of a reference that was rolled out from the same seeds.

    Robots of a seed start alike, are commanded alike and feel the same noise. They are compared one
    by one, which leaves out how much robots differ by their commands: the interval is that of a
    ratio of paired means, to first order in the errors.

    Args:
        scores: Scores, a row a robot.
        by: Columns whose values make a group.
        reference: Scores of the reference, its robots in the order of each group's.

    Returns:
        A row a group: `share` of the reference's mean return, and its 95 % interval `share_ci`.
    """
    whole = reference["return"].to_numpy(dtype=float)
    rows = []
    for keys, group in scores.groupby(by, sort=False):
        own = group["return"].to_numpy(dtype=float)
        share = own.mean() / whole.mean()
        half = interval(pd.Series(own - share * whole)) / abs(whole.mean())
        rows.append({**dict(zip(by, keys, strict=True)), "share": share, "share_ci": half})
    return pd.DataFrame(rows)


def not_finite_lines(scores: pd.DataFrame) -> list[str]:
    """Says where a policy gave no action: among the falls, it would look like any other."""
    lines = []
    lost = scores[scores["not_finite"] != ""]
    labels = list(scores.columns[: scores.columns.get_loc("robot")])
    for keys, own in lost.groupby(labels, sort=False):
        first = own.sort_values("steps").iloc[0]
        lines.append(
            f"{' '.join(map(str, keys))}: the action of {first['not_finite']} is not finite at "
            f"control step {first['steps'] - 1}, robot {first['robot']}; so it is for {len(own)} "
            "robots, which count as fallen"
        )
    return lines


PLACES = ("gait", "scenario")
"""Columns in which a policy and its reference agree."""


def wilson_interval(count: int, n: int) -> tuple[float, float]:
    """Returns the 95 % interval of a share, by Wilson's score."""
    bounds = stats.binomtest(count, n).proportion_ci(confidence_level=0.95, method="wilson")
    return float(bounds.low), float(bounds.high)


def summary(scores: pd.DataFrame, by: Sequence[str], against: str | None = None) -> pd.DataFrame:
    """Averages scores over robots, with falls and intervals.

    Args:
        scores: Scores, a row a robot.
        by: Columns that distinguish groups.
        against: The policy that others are compared with, robot by robot, where gait and scenario
            are the same; none by default.

    Returns:
        A row a group, in the order of the scores: what `summarize` returns; the 95 % interval of
        the share of falls, `fall_rate_low` and `fall_rate_high`; and, where there is a reference,
        `points_more` falls of a hundred than it, and the `share` of its return with its paired
        interval `share_ci`.
    """
    keys = list(by)
    table = summarize(scores, keys)
    pairs = zip(table["falls"], table["robots"], strict=True)
    table[["fall_rate_low", "fall_rate_high"]] = [wilson_interval(*pair) for pair in pairs]
    if against is None:
        return table
    places = [name for name in PLACES if name in keys]
    groups = scores.groupby(places, sort=False) if places else [((), scores)]
    parts = []
    for _, group in groups:
        reference = group[group["policy"] == against]
        own = return_shares(group, keys, reference)
        parts.append(own.assign(expected=float(reference["fell"].mean())))
    table = table.merge(pd.concat(parts, ignore_index=True), on=keys)
    table["points_more"] = 100.0 * (table["fall_rate"] - table.pop("expected"))
    return table
