"""Two policies of one gait: their files' lines, their joint targets, and one replay of both."""

from dataclasses import dataclass
from difflib import unified_diff
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from glassgait.diagrams.commands import SliderCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.pair_replay import ReplayedRobot, save_pair_replay
from glassgait.diagrams.rollout import Rollout
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.task_config import NO_SLIDERS
from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.policies.policy import Policy, first_not_finite
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait
from glassgait.models.task.palette import COLORS
from glassgait.studies.common.console import say
from glassgait.studies.common.experiment import Report
from glassgait.studies.common.figures import COLUMN_WIDTH, styled, subplots
from glassgait.studies.common.play import roll_one_out
from glassgait.studies.common.tables import json_records
from glassgait.studies.distillation.students.registry import policy_title

PAIR_COLORS = (COLORS[0], COLORS[-1])
"""Blue and vermilion, which colour-blind readers distinguish too."""

DIFFERENCES = "RdBu_r"
"""Colours of two hues that colour-blind readers distinguish, white where both ask for the same."""

ALL_JOINTS = "all"
"""Name of the row of `joint_table` that is of all joints together."""

TITLES = {
    "joint": "joint",
    "rms": "root mean square (rad)",
    "largest": "largest (rad)",
    "time": "at (s)",
}
"""What people call the columns of `joint_table`."""


@dataclass(frozen=True)
class Pair:
    """Two policies, A and B.

    Attributes:
        gait: Their gait.
        controllers: Each alone, by name: A, then B.
        world: Where targets are compared and the replay is recorded.
    """

    gait: Gait
    controllers: dict[str, AlternatingController]
    world: Scenario

    def __post_init__(self) -> None:
        """Refuses a world in which no single robot can be rolled out.

        Raises:
            InputError: if its commands are of sliders, its engine is not Drake, or the gait is not
                made for its command.
        """
        if isinstance(self.world.command, SliderCommand):
            raise InputError(f"{self.world.refused_as()}: {NO_SLIDERS}")
        if self.world.station.engine != "drake":
            raise InputError(
                f"{self.world.refused_as()}: targets and replay are of the first scenario, and one "
                "robot needs Drake; name another first with --scenario, such as training"
            )
        self.world.command.check(self.gait)

    @property
    def titles(self) -> tuple[str, str]:
        """What people call them; the letter distinguishes two files of one name."""
        a, b = (policy_title(name) for name in self.controllers)
        return f"A: {a}", f"B: {b}"

    @property
    def policies(self) -> tuple[Policy, Policy]:
        """The policies."""
        a, b = (controller.policy for controller in self.controllers.values())
        return a, b

    def report(self, n_steps: int, seed: int) -> Report:
        """Rolls one robot of each out, and reports in what the policies differ.

        Args:
            n_steps: Control steps of the rollouts; a fall ends one before.
            seed: Seed of both.
        """
        say("rolling one robot of each out, for targets and replay")
        rollouts = [self._roll_out(own, n_steps, seed) for own in self.controllers.values()]
        difference = target_difference(rollouts[0], *self.policies)
        joints, lines = joint_table(difference), changed_lines(self)
        title = f"{self.gait.name}: {self.titles[0]} acts; {self.titles[1]}"
        ends = [_end(rollout) for rollout in rollouts]
        robots = [
            ReplayedRobot(letter, f"{name}{_fall(end)}", color, rollout, own.robot)
            for letter, name, end, color, rollout, own in zip(
                "AB", self.titles, ends, PAIR_COLORS, rollouts, self.policies, strict=True
            )
        ]
        files: dict[str, Any] = {"replay.html": partial(save_pair_replay, *robots)}
        if lines:
            files["lines.diff"] = "\n".join(lines) + "\n"
        return Report(
            tables={"targets": joints.rename(columns=TITLES)},
            metrics={
                "policies": dict(zip("AB", self.controllers, strict=True)),
                "lines": None
                if lines is None
                else {"only_a": only(lines, "-"), "only_b": only(lines, "+")},
                "targets": json_records(joints),
                "walks": dict(zip("AB", ends, strict=True)),
            },
            figures={"targets": difference_figure(difference, title)},
            lines=[line_sentence(self, lines), target_sentence(joints), "replay.html shows both"],
            files=files,
        )

    def _roll_out(self, controller: AlternatingController, n_steps: int, seed: int) -> Rollout:
        diagram = MakeLocomotion(self.gait, self.world, policy=controller)
        return roll_one_out(diagram, self.world, n_steps=n_steps, seed=seed)


@dataclass(frozen=True)
class TargetDifference:
    """The targets of B less those of A, at every observation of a rollout where A acted.

    Attributes:
        time: The control instants (n; s).
        values: The differences (n, 12; rad); NaN where a target is not finite.
    """

    time: Array
    values: Array


def changed_lines(pair: Pair) -> list[str] | None:
    """Returns a unified difference of both files; None where one is not made of formulas.

    Raises:
        InputError: if the observations are not those of the task.
    """
    texts = [own.to_text().splitlines() for own in pair.policies if isinstance(own, FormulaPolicy)]
    if len(texts) < 2:
        return None
    return list(unified_diff(texts[0], texts[1], *pair.titles, lineterm=""))


def only(lines: list[str], sign: str) -> int:
    """Counts the lines that one file alone has: A's begin with a minus, B's with a plus."""
    # The first two lines name the files, by the same signs.
    return sum(line.startswith(sign) for line in lines[2:])


def line_sentence(pair: Pair, lines: list[str] | None) -> str:
    """Says how much the files differ, or why there is nothing to compare."""
    if lines is None:
        others = [
            f"{letter} is of the kind {policy.kind}"
            for letter, policy in zip("AB", pair.policies, strict=True)
            if not isinstance(policy, FormulaPolicy)
        ]
        return f"no lines to compare: {' and '.join(others)}, and only formulas are text"
    if not lines:
        return "the files say the same"
    return f"lines of A alone: {only(lines, '-')}, of B alone: {only(lines, '+')}; see lines.diff"


def target_difference(rollout: Rollout, a: Policy, b: Policy) -> TargetDifference:
    """Returns the targets of B less those of A at the observations of a rollout.

    Args:
        rollout: What A did.
        a: The policy that acted.
        b: The other one.
    """
    observations = rollout["observations"]
    targets_a, targets_b = (policy.robot.joint_targets(policy(observations)) for policy in (a, b))
    values = targets_b - targets_a
    if lost := first_not_finite(values):
        step, joint = lost
        say(
            f"a target of {quadruped.JOINTS[joint]} is not finite at control step {step}; what is "
            "not finite is left out of the differences"
        )
        values = np.where(np.isfinite(values), values, np.nan)
    return TargetDifference(rollout.time, values)


def joint_table(difference: TargetDifference) -> pd.DataFrame:
    """Sums up the differences of every joint.

    Returns:
        A row a joint, and a last one of `ALL_JOINTS`: `rms`, the root mean square (rad); `largest`,
        the greatest absolute one (rad), and its `time` (s). NaN where no difference is finite.
    """
    rows = [
        _row(joint, difference.time, difference.values[:, [index]])
        for index, joint in enumerate(quadruped.JOINTS)
    ]
    return pd.DataFrame([*rows, _row(ALL_JOINTS, difference.time, difference.values)])


def target_sentence(table: pd.DataFrame) -> str:
    """Says how much the targets differ, and where most."""
    joints, whole = table.iloc[:-1], table.iloc[-1]
    if not np.isfinite(whole["rms"]):
        return "no difference of targets is finite"
    most = joints.iloc[int(np.nanargmax(joints["largest"]))]
    return (
        f"at the same observations targets differ by {whole['rms']:.3g} rad (root mean square), "
        f"most by {most['largest']:.3g} rad, of {most['joint']} at {most['time']:.2f} s"
    )


@styled
def difference_figure(difference: TargetDifference, title: str) -> Figure:
    """Draws the targets of B less those of A, a row a joint, over time.

    Args:
        difference: The differences; grey where they are not finite.
        title: What stands above.
    """
    figure, axes = subplots(figsize=(2 * COLUMN_WIDTH, 2.6))
    greatest = float(np.nanmax(np.abs(difference.values), initial=0.0)) or 1.0
    time = difference.time
    edges = (time[0], time[-1] + CONTROL_PERIOD, quadruped.N_JOINTS - 0.5, -0.5)
    picture = axes.imshow(
        difference.values.T,
        aspect="auto",
        cmap=DIFFERENCES,
        vmin=-greatest,
        vmax=greatest,
        extent=edges,
        interpolation="nearest",
    )
    axes.set_facecolor("0.6")
    axes.grid(visible=False)
    axes.set_yticks(
        range(quadruped.N_JOINTS), [name.replace("_", " ") for name in quadruped.JOINTS]
    )
    for leg in range(1, quadruped.N_LEGS):
        axes.axhline(len(quadruped.LEG_JOINTS) * leg - 0.5, color="0.3", linewidth=0.5)
    axes.set(xlabel="time (s)", title=title)
    figure.colorbar(picture, ax=axes).set_label("target of B less that of A (rad)")
    return figure


def _row(joint: str, time: Array, values: Array) -> dict[str, float | str]:
    if np.isnan(values).all():
        return {"joint": joint, "rms": np.nan, "largest": np.nan, "time": np.nan}
    distance = np.abs(values)
    step, column = np.unravel_index(np.nanargmax(distance), distance.shape)
    return {
        "joint": joint,
        "rms": float(np.sqrt(np.nanmean(values**2))),
        "largest": float(distance[step, column]),
        "time": float(time[step]),
    }


def _end(rollout: Rollout) -> dict[str, Any]:
    """Returns whether and when a rollout ended by a fall."""
    return {"fell": rollout.failed, "seconds": round(float(rollout.time[-1] - rollout.time[0]), 6)}


def _fall(end: dict[str, Any]) -> str:
    return f", fell after {end['seconds']:.2f} s" if end["fell"] else ""
