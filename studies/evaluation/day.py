"""`glassgait evaluate day`: robots that rise, stand, walk and lie down."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, ClassVar

import pandas as pd
from annotated_types import Ge, Le, MinLen

from glassgait.models.settings import DISTINCT, FEW
from glassgait.models.task.day import SHIPPED as SHIPPED_DAY
from glassgait.models.task.day import Day, load_day
from glassgait.studies.common.cases import Case
from glassgait.studies.common.experiment import Experiment, PolicyNames, Report, ScenarioNames
from glassgait.studies.common.policies import EXPERT
from glassgait.studies.common.sweep import Seeds
from glassgait.studies.common.tables import json_records
from glassgait.studies.distillation.students.registry import policy_title
from glassgait.studies.evaluation.day_rollouts import RobotsDay, roll_day

PushSpeed = Annotated[float, Ge(0.0), Le(10.0)]

KEYS = ["gait", "policy", "scenario", "push"]

TITLES = {
    "gait": "gait",
    "policy": "policy",
    "world": "scenario",
    "push": "push (m/s)",
    "robots": "robots",
    "falls": "falls",
    "fell_in": "falls in",
    "risen": "risen after (s)",
    "standing": "all feet down while standing",
    "foot_movement": "farthest foot movement then (mm)",
    "torque": "greatest torque (N·m)",
    "lying": "lie at rest in the end",
    "over": "leaned beyond the day's lean",
    "over_damped": "of them damped",
    "end_height": "greatest height in the end (m)",
}
"""What people call the columns of `day_table`."""


@dataclass(frozen=True)
class DayOfRobots(Experiment):
    """Let robots rise, stand, walk and lie down, push some over, and report falls by mode.

    Attributes:
        day: `day`, which ships, or path of a day's file.
        pushes: Horizontal velocities that are added to a trunk once, while it walks (m/s); 0 for
            none.
    """

    title: ClassVar[str] = "evaluate day"
    together: ClassVar[bool] = True
    discrete: ClassVar[bool] = True
    axes: ClassVar[Mapping[str, str]] = {"push": "pushes"}
    inputs: ClassVar[Mapping[str, str]] = {"day": "day_digest"}

    policy: PolicyNames = (EXPERT,)
    scenario: ScenarioNames = ("training", "mujoco")
    n_seeds: Seeds = 5
    day: str = SHIPPED_DAY
    pushes: Annotated[tuple[PushSpeed, ...], MinLen(1), FEW, DISTINCT] = (0.0, 4.0)

    @cached_property
    def robots_day(self) -> Day:
        """The day."""
        return load_day(self.day)

    @property
    def day_digest(self) -> str:
        """A digest of the day."""
        return self.robots_day.digest()

    def measure(self, case: Case) -> pd.DataFrame:
        """Rolls robots of one seed out over a day."""
        return roll_day(
            RobotsDay(
                self.robots_day,
                case.gait,
                case.alone,
                case.scenario,
                self.n_robots,
                case.seed,
                case.labels["push"],
            )
        )

    def report(self, table: pd.DataFrame) -> Report:
        """Reports falls by mode, how robots stand, and where pushed ones end."""
        whole = day_table(table, self.robots_day)
        readable = readable_table(whole, self.scenario_titles)
        return Report(
            tables={"robots": table, "day": readable},
            metrics=json_records(whole),
            shown={"a day": readable},
        )


def day_table(robots: pd.DataFrame, day: Day) -> pd.DataFrame:
    """Sums up the robots of each policy, scenario and push.

    Args:
        robots: What `roll_day` returned, with labels.
        day: Their day.

    Returns:
        A row a gait, policy, scenario and push: robots, falls, and in which modes; means of
        `risen` and `standing`; greatest `foot_movement`, `torque` and `end_height`; how many are in
        the day's first mode in the end, `lying`; how many leaned beyond its `lean`, and how many
        of these were damped.
    """
    torques = [name for name in robots if str(name).startswith("torque_")]
    robots = robots.assign(
        torque=robots[torques].max(axis=1),
        lying=robots["end"] == day.initial,
        over=robots["leaned"] > day.lean,
    )
    robots["over_damped"] = robots["over"] & robots["damped"]
    return (
        robots.groupby(KEYS, sort=False)
        .agg(
            robots=("robot", "size"),
            falls=("fell", "sum"),
            fell_in=("fell_in", _counted),
            risen=("risen", "mean"),
            standing=("standing", "mean"),
            foot_movement=("foot_movement", "max"),
            torque=("torque", "max"),
            lying=("lying", "sum"),
            over=("over", "sum"),
            over_damped=("over_damped", "sum"),
            end_height=("end_height", "max"),
        )
        .reset_index()
    )


def readable_table(table: pd.DataFrame, titles: Mapping[str, str]) -> pd.DataFrame:
    """Names the policies, scenarios and columns of `day_table` as people do."""
    named = table.assign(
        policy=[policy_title(name) for name in table["policy"]],
        world=[titles[name] for name in table["scenario"]],
    )
    return named[list(TITLES)].rename(columns=TITLES)


def _counted(modes: pd.Series) -> str:
    """Writes how many fell in each mode."""
    counts = modes[modes != ""].value_counts(sort=False)
    return ", ".join(f"{mode} {count}" for mode, count in counts.items()) or "–"
