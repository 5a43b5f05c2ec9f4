"""`glassgait evaluate tracking`: measured speeds of robots that keep one command."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from glassgait.models.arrays import Array
from glassgait.models.settings import Count, Range
from glassgait.models.task.command import Command
from glassgait.models.task.gait import Gait
from glassgait.models.task.palette import COLORS
from glassgait.studies.common.cases import Case
from glassgait.studies.common.episode import give
from glassgait.studies.common.experiment import Experiment, PolicyNames, Report
from glassgait.studies.common.figures import COLUMN_WIDTH, styled, subplots
from glassgait.studies.common.policies import EXPERT
from glassgait.studies.common.scores import interval
from glassgait.studies.common.tables import json_records
from glassgait.studies.distillation.students.registry import policy_title

SPEEDS = (-0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75)
"""Forward speeds that are commanded (m/s), without turning, as far as the gait goes."""

YAW_RATES = (-0.8, -0.4, 0.4, 0.8)
"""Yaw rates that are commanded (rad/s), at `TURNING_SPEED`."""

TURNING_SPEED = 0.5
"""Forward speed at which yaw rates are commanded (m/s), or the greatest below it."""

SETTLED_SHARE = 0.5
"""Share of the steps, at the end, over which speed and yaw rate are averaged."""

COMMANDED = ["commanded speed (m/s)", "commanded yaw rate (rad/s)"]
MEASURED = ["measured speed (m/s)", "measured yaw rate (rad/s)"]


@dataclass(frozen=True)
class Tracking(Experiment):
    """Let robots keep one command each, and report how fast they go and turn.

    Attributes:
        n_robots: Robots for each command; their dwells are spread over the gait's range.
        n_steps: Control steps that a command is kept.
        speed_range: Least and greatest commanded forward speed (m/s); the gait's by default.
    """

    title: ClassVar[str] = "evaluate tracking"
    together: ClassVar[bool] = True
    discrete: ClassVar[bool] = True
    one: ClassVar[tuple[str, ...]] = ("scenario",)

    policy: PolicyNames = (EXPERT,)
    n_robots: Count = 8
    n_steps: Count = 500
    speed_range: Range | None = None

    def measure(self, case: Case) -> pd.DataFrame:
        """Rolls robots out that keep one command each.

        Returns:
            A row a robot: `dwell` (control steps), what was commanded, `fell`, and the means
            measured over the last half of the rollout, NaN of a robot that fell.
        """
        n = self.n_robots
        commands = steady_commands(case.gait, self.speed_range)
        given = Command(
            np.repeat(commands, n, axis=0),
            np.tile(np.rint(np.linspace(*case.gait.dwell, n)), len(commands)),
        )
        log = case.roll_out(len(given.dwell), self.n_steps, events=[give(0, given)])
        fell = np.asarray(log.failures.any(axis=(0, 2)))
        measured = log.velocity[-max(1, round(SETTLED_SHARE * self.n_steps)) :].mean(axis=0)
        measured[fell] = np.nan
        rows = pd.DataFrame(given.velocity, columns=COMMANDED).assign(dwell=given.dwell)
        rows["fell"] = fell
        rows[MEASURED] = measured
        return rows

    def report(self, table: pd.DataFrame) -> Report:
        """Reports what is measured for each command, by policy or, of one policy, by gait."""
        by = "policy" if table["policy"].nunique() > 1 else "gait"
        means = tracking_table(table, by)
        gaits = ", ".join(table["gait"].unique())
        policies = ", ".join(map(policy_title, table["policy"].unique()))
        scenario = self.scenario_titles[table["scenario"].iloc[0]]
        title = f"{gaits}: {policies}: commanded and measured, {scenario}"
        return Report(
            tables={"robots": table, "tracking": means},
            metrics=json_records(means),
            figures={"tracking": tracking_figure(means, title)},
            shown={title: means.assign(**{by: means[by].map(policy_title)})},
        )


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


def tracking_table(rows: pd.DataFrame, by: str) -> pd.DataFrame:
    """Averages over robots that were given the same command.

    Args:
        rows: What `measure` returned of all policies.
        by: The column by which lines differ.

    Returns:
        A row a policy and command: means over the robots that did not fall, half the widths of
        their 95 % intervals, and how many fell.
    """
    means = []
    for keys, group in rows.groupby([by, *COMMANDED], sort=False):
        row = dict(zip([by, *COMMANDED], keys, strict=True))
        for name in MEASURED:
            row |= {name: group[name].mean(), f"{name.split(' (')[0]} ±": interval(group[name])}
        means.append(row | {"robots": len(group), "falls": int(group["fell"].sum())})
    return pd.DataFrame(means)


@styled
def tracking_figure(table: pd.DataFrame, title: str) -> Figure:
    """Draws measured against commanded speed and yaw rate, a line a policy or gait.

    Speeds are those of robots that do not turn, yaw rates those of robots that go at one speed. A
    robot that follows its command is on the dotted line.

    Args:
        table: What `tracking_table` returned.
        title: The legend's title.
    """
    figure, panels = subplots(1, 2, figsize=(2 * COLUMN_WIDTH, 3.2))
    policy_column = str(table.columns[0])
    straight = table[COMMANDED[1]] == 0.0
    turning = table[COMMANDED[0]] == table.loc[~straight, COMMANDED[0]].max()
    for axes, commanded, measured, rows in zip(
        panels, COMMANDED, MEASURED, (straight, turning), strict=True
    ):
        shown = table[rows].sort_values(commanded)
        if len(shown):
            ends = [shown[commanded].min(), shown[commanded].max()]
            axes.plot(ends, ends, color="black", linewidth=0.8, linestyle=":")
        for i, name in enumerate(table[policy_column].unique()):
            mine = shown[shown[policy_column] == name]
            axes.errorbar(
                mine[commanded],
                mine[measured],
                mine[f"{measured.split(' (')[0]} ±"],
                label=policy_title(str(name)),
                color=COLORS[i % len(COLORS)],
                marker="osv^Dx"[i % 6],
                markersize=3.5,
                linewidth=1.0,
                capsize=1.5,
            )
        axes.set(xlabel=commanded, ylabel=measured)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3, title=title)
    return figure
