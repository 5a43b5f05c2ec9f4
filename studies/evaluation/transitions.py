"""`glassgait evaluate transitions`: gaits that change while walking."""

import textwrap
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import Annotated, Any, ClassVar

import pandas as pd
from annotated_types import Ge, Le, MinLen
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import PercentFormatter

from glassgait.diagrams.commands import FixedCommand
from glassgait.models.errors import InputError
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.policies.library import find_gait
from glassgait.models.policies.switched import GREATEST_CHANGE
from glassgait.models.settings import DISTINCT, FEW, NotNegative, Positive, Share
from glassgait.models.task.gait import Gait
from glassgait.models.task.gait_switch import PATIENCE, GaitSwitch
from glassgait.studies.common.cases import Case
from glassgait.studies.common.experiment import Experiment, PolicyNames, Report
from glassgait.studies.common.figures import styled, subplots
from glassgait.studies.common.policies import EXPERT, find_policies
from glassgait.studies.common.sweep import Gaits
from glassgait.studies.common.tables import json_records
from glassgait.studies.distillation.students.registry import policy_title
from glassgait.studies.evaluation.transition_rollouts import Transition, roll_transition
from glassgait.studies.evaluation.worlds_figures import COLORS, readable_on

Speed = Annotated[float, Ge(-3.0), Le(3.0)]

KEYS = ["policy", "scenario", "from", "to", "speed"]

TITLES = {
    "policy": "policy",
    "world": "scenario",
    "from": "from",
    "to": "to",
    "speed": "speed (m/s)",
    "robots": "robots",
    "falls": "falls",
    "before": "of them before the request",
    "wait": "wait (s)",
    "longest_wait": "longest wait (s)",
    "settling": "rhythm kept after (s)",
    "longest_settling": "at the latest after (s)",
    "unsettled": "never kept",
    "share": "share of the return",
}
"""What people call the columns of `transition_table`."""


@dataclass(frozen=True)
class Transitions(Experiment):
    """Change the gait of walking robots, each to each, and report falls and waits.

    Attributes:
        speeds: Commanded forward speeds (m/s).
        patience: Multiple of the commanded steps in a state after which a gait is waited for no
            more; with 0 gaits change at once, whatever the feet do.
        greatest_change: Greatest squared change of the action in a control step.
        slowdown: Factor on the commanded speed from the request until a second after the change.
        via: A gait on the way between any two others; none by default.
    """

    title: ClassVar[str] = "evaluate transitions"
    together: ClassVar[bool] = True
    discrete: ClassVar[bool] = True
    n_seeds: ClassVar[int] = 1
    axes: ClassVar[Mapping[str, str]] = {"to": "targets", "speed": "speeds"}

    gait: Gaits = ("walk", "trot", "pace", "bound")
    policy: PolicyNames = (EXPERT,)
    speeds: Annotated[tuple[Speed, ...], MinLen(1), FEW, DISTINCT] = (0.3, 0.4, 0.5)
    patience: NotNegative = PATIENCE
    greatest_change: Positive = GREATEST_CHANGE
    slowdown: Share = 1.0
    via: str | None = None

    @property
    def targets(self) -> dict[str, "Target"]:
        """The gaits that robots change to, by name.

        Raises:
            InputError: if there are fewer than two gaits, or one is not made for a speed.
        """
        if len(self.gaits) < 2:
            raise InputError(f"{self.title}: one gait changes to no other; name two with --gait")
        found = {gait.name: Target(gait, self.controllers[gait.name]) for gait in self.gaits}
        way = {}
        if self.via is not None:
            gait = find_gait(self.via, self.robot)
            controllers = self.controllers.get(gait.name) or find_policies(
                gait, robot=self.robot
            ).controllers(self.policy)
            way = {gait.name: Target(gait, controllers)}
        common = GaitSwitch([own.gait for own in (found | way).values()]).gait
        for speed in self.speeds:
            FixedCommand(speed=speed, dwell=common.dwell[0]).check(common)
        via = next(iter(way.values()), None)
        return {name: own if name in way else replace(own, via=via) for name, own in found.items()}

    def measure(self, case: Case) -> pd.DataFrame:
        """Rolls out robots that change from one gait to another, or that never change."""
        policy, path = case.labels["policy"], path_of(case)
        if any(policy not in own.controllers for own in path):
            return pd.DataFrame()
        return roll_transition(
            Transition(
                tuple(own.gait for own in path),
                tuple(own.controllers[policy] for own in path),
                case.scenario,
                case.labels["speed"],
                self.n_robots,
                case.seed,
                self.patience,
                self.greatest_change,
                self.slowdown,
            )
        )

    def report(self, table: pd.DataFrame) -> Report:
        """Reports falls and waits of each pair of gaits."""
        robots = in_order(table.rename(columns={"gait": "from"}))
        titles, whole = self.scenario_titles, transition_table(robots)
        return Report(
            tables={"robots": robots, "transitions": readable_table(whole, titles)},
            metrics=json_records(whole),
            figures={"transitions": transition_figure(whole, titles)},
            shown={"robots that change the gait without a fall": summary_table(whole, titles)},
        )


@dataclass(frozen=True)
class Target:
    """A gait that robots change to.

    Attributes:
        gait: The gait.
        controllers: What acts in it, by policy.
        via: The gait on the way there from any other.
    """

    gait: Gait
    controllers: dict[str, AlternatingController]
    via: "Target | None" = None

    def digest(self) -> list[Any]:
        """Returns a digest that differs where robots would not walk alike."""
        policies = [one for own in self.controllers.values() for one in own.policies.values()]
        via = None if self.via is None else self.via.digest()
        return [self.gait.digest(), *(one.digest() for one in policies), via]


def path_of(case: Case) -> list[Target]:
    """Lists the gaits of a case as they are requested; of one alone nothing changes."""
    source = Target(case.gait, {case.labels["policy"]: case.alone})
    names, target = {case.gait.name, case.labels["to"]}, case.values["to"]
    if len(names) == 1:
        return [source]
    between = [] if target.via is None or target.via.gait.name in names else [target.via]
    return [source, *between, target]


def in_order(robots: pd.DataFrame) -> pd.DataFrame:
    """Puts robots that never change before the others, for each policy, scenario and speed."""
    by = robots[["policy", "scenario", "speed"]].apply(lambda column: pd.factorize(column)[0])
    by["changes"] = robots["from"] != robots["to"]
    ordered = robots.loc[by.sort_values(list(map(str, by)), kind="stable").index]
    return ordered[[*KEYS, *ordered.columns[ordered.columns.get_loc("robot") :]]]


def transition_table(robots: pd.DataFrame) -> pd.DataFrame:
    """Sums up every pair of gaits at every speed, in the order in which they were rolled out.

    Args:
        robots: What `roll_transition` returned of every pair, and of every gait that does not
            change.

    Returns:
        A row a policy, world, pair and speed: robots, their falls, how many of these came before
        the request; means and greatest values of `wait` and `settling` (s); robots whose rhythm was
        never kept; the share of the reward that robots earn which walked in the new gait all the
        time.
    """
    groups = robots.groupby(KEYS, sort=False)
    table = groups.agg(
        robots=("robot", "size"),
        falls=("fell", "sum"),
        before=("before", "sum"),
        wait=("wait", "mean"),
        longest_wait=("wait", "max"),
        settling=("settling", "mean"),
        longest_settling=("settling", "max"),
        unsettled=("settling", lambda own: int(own.isna().sum())),
        reward=("reward", "mean"),
    ).reset_index()
    stayed = table["from"] == table["to"]
    references = table[stayed].set_index(["policy", "scenario", "to", "speed"])["reward"]
    own = pd.MultiIndex.from_frame(table[["policy", "scenario", "to", "speed"]])
    table["share"] = table["reward"].to_numpy() / references.reindex(own).to_numpy()
    return table


def readable_table(table: pd.DataFrame, titles: dict[str, str]) -> pd.DataFrame:
    """Names the policies, worlds and columns of `transition_table` as people do.

    Args:
        table: What `transition_table` returned.
        titles: What people call each scenario.
    """
    named = table.assign(
        policy=[policy_title(name) for name in table["policy"]],
        world=[titles[name] for name in table["scenario"]],
    )
    return named[list(TITLES)].rename(columns=TITLES)


def summary_table(table: pd.DataFrame, titles: dict[str, str]) -> pd.DataFrame:
    """Counts for each policy and world how many pairs change without a fall, and which do not."""
    pairs = table[table["from"] != table["to"]]
    rows = []
    for (policy, scenario), own in pairs.groupby(["policy", "scenario"], sort=False):
        falls = own.groupby(["from", "to"], sort=False)["falls"].sum()
        ends = zip(*(falls.index.get_level_values(name) for name in ("from", "to")), strict=True)
        falling = [
            f"{source} to {target} {count}"
            for (source, target), count in zip(ends, falls, strict=True)
            if count > 0
        ]
        rows.append(
            {
                "policy": policy_title(str(policy)),
                "scenario": titles[str(scenario)],
                "pairs without a fall": f"{(falls == 0).sum()} of {len(falls)}",
                "falls": f"{falls.sum()} of {own['robots'].sum()}",
                "falls from, to": ", ".join(falling) or "–",
                "longest wait (s)": own["longest_wait"].max(),
            }
        )
    return pd.DataFrame(rows)


CELL = 0.42
"""Size of a cell (inches)."""


@styled
def transition_figure(table: pd.DataFrame, titles: dict[str, str]) -> Figure:
    """Draws a matrix of each speed, a row of them a policy and world, darker where more fall.

    On the diagonal stand robots that never changed.

    Args:
        table: What `transition_table` returned.
        titles: What people call each scenario.
    """
    lines = table[["policy", "scenario"]].drop_duplicates().to_numpy().tolist()
    speeds, gaits = table["speed"].unique(), table["from"].unique().tolist()
    width, height = CELL * len(gaits) + 0.35, CELL * len(gaits) + 0.45
    size = (1.9 + width * len(speeds), 0.9 + height * len(lines))
    figure, panels = subplots(
        len(lines), len(speeds), figsize=size, squeeze=False, sharex=True, sharey=True
    )
    for (i, (policy, world)), (j, speed) in product(enumerate(lines), enumerate(speeds)):
        chosen = (table["policy"] == policy) & (table["scenario"] == world)
        cells = table[chosen & (table["speed"] == speed)]
        axes = panels[i, j]
        _draw_matrix(axes, cells, gaits)
        if i == 0:
            axes.set_title(f"{speed:g} m/s", fontsize=8)
        if j == 0:
            title = f"{policy_title(policy)}, {titles[world]}"
            axes.set_ylabel(f"{textwrap.fill(title, 24)}\n\nfrom", fontsize=7)
        if i == len(lines) - 1:
            axes.set_xlabel("to")
    bar = figure.colorbar(
        ScalarMappable(Normalize(0, 1), COLORS), ax=panels, format=PercentFormatter(1.0), shrink=0.8
    )
    bar.set_label("share of robots that fall")
    most = int(table["robots"].max())
    caption = (
        f"Falls of {most} robots each, ·\N{NO-BREAK SPACE}is none; framed: robots that never "
        "change their gait."
    )
    figure.supxlabel(textwrap.fill(caption, round(17 * size[0])), fontsize=7)
    return figure


def _draw_matrix(axes: Axes, cells: pd.DataFrame, gaits: list[str]) -> None:
    for cell in cells.to_dict("records"):
        x, y = gaits.index(cell["to"]), gaits.index(cell["from"])
        falls = int(cell["falls"])
        color = COLORS(falls / cell["robots"])[:3] if falls else (1.0, 1.0, 1.0)
        look = {"facecolor": color, "edgecolor": "0.85", "linewidth": 0.5}
        axes.add_patch(Rectangle((x - 0.5, y - 0.5), 1, 1, **look))
        text, ink = (str(falls), readable_on(color)) if falls else ("·", "0.4")
        axes.text(x, y, text, color=ink, fontsize=7, ha="center", va="center")
    for i in range(len(gaits)):
        axes.add_patch(
            Rectangle((i - 0.5, i - 0.5), 1, 1, fill=False, edgecolor="black", linewidth=0.9)
        )
    axes.set(xlim=(-0.55, len(gaits) - 0.45), ylim=(len(gaits) - 0.45, -0.55), aspect="equal")
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0)
    names = [name.replace("_", "-") for name in gaits]
    axes.set_xticks(range(len(gaits)), names, fontsize=6.5, rotation=45, ha="right")
    axes.set_yticks(range(len(gaits)), names, fontsize=6.5)
