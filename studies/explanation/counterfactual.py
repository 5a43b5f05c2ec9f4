"""`glassgait explain counterfactual`: finds the values of observations at which an action changes.

Each observation is varied over its operating range while all others are constant.
"""

from dataclasses import field
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
import pandas as pd
from annotated_types import Ge
from matplotlib.figure import Figure

from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import make_simulator, record
from glassgait.diagrams.scenario import Scenario
from glassgait.models.arrays import Array
from glassgait.models.certificates.box import COUNTED, ObservationBox, load_box, operating_box
from glassgait.models.errors import InputError
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.policies.policy import Policy
from glassgait.models.robots.quadruped import joint_index
from glassgait.models.settings import Seed, checked
from glassgait.models.task.observation import entries_of
from glassgait.studies.common.console import console
from glassgait.studies.common.figures import COLUMN_WIDTH, save_figure, styled, subplots
from glassgait.studies.common.rollouts import CommandOverride
from glassgait.studies.common.tables import print_table, write_table
from glassgait.studies.distillation.students import OnePolicy

N_VALUES, N_BISECTIONS = 401, 30
"""Number of values of an observation, evenly over its range, and of bisections between two."""

N_DRAWN = 6
COLUMNS = pd.Index(["observation", "value", "passes at", "unit", "share of range", "target (rad)"])


@checked
class ExplainCounterfactual(OnePolicy):
    """Find the value of each observation at which a joint's target passes a level.

    Attributes:
        joint: The joint.
        level: Level of the joint's target (rad); by default 0.1 rad above its target at the step.
        step: Control step of the rollout whose observation is varied.
        command: Commanded speed (0.5 m/s, or the gait's greatest), yaw rate and rhythm.
        box: File of the operating box; the gait's shipped one by default.
        seed: Seed of the sensors' noise.
        output: Folder of the results; below runs/explain/counterfactual/<gait> by default.
    """

    title: ClassVar[str] = "explain counterfactual"

    joint: str = "FR_calf"
    level: float | None = None
    step: Annotated[int, Ge(0)] = 280
    command: CommandOverride = field(default_factory=CommandOverride)
    box: Path | None = None
    seed: Seed = 0
    output: Path | None = None

    def run(self) -> None:
        """Rolls out, scans each observation, and writes the table and the figure."""
        policies, name = self.find()
        gait, robot, controller = policies.gait, policies.robot, policies.controller(name)
        if controller.policy.remembers:
            raise InputError(f"--policy {name}: acts on past observations, too; name a student")
        box = load_box(self.box, gait, robot) if self.box else operating_box(gait, robot)

        # Roll out up to the step.
        scenario = Scenario(command=self.command.override(gait))
        diagram = MakeLocomotion(gait, scenario, policy=controller)
        rollout = record(make_simulator(diagram, seed=self.seed), self.step + 1)
        if len(rollout.time) <= self.step:
            fall = f"the robot falls at step {len(rollout.time) - 1}"
            raise InputError(f"--step {self.step}: {fall}; name an earlier step")

        # Vary the observation at this step.
        observation = rollout["observation"][self.step]
        scan = Scan(controller.policy, joint_index(self.joint), observation, box)
        level = scan.target + 0.1 if self.level is None else self.level
        table = scan.passes(level)
        stem = f"{Path(name).stem}_{self.joint}_{self.step}"
        folder = self.output or policies.output(self.title) / stem
        write_table(table, folder / "counterfactual")
        save_figure(scan.figure(table, level), folder / "counterfactual")
        print_table(f"{self.joint}: {scan.target:.3f} rad, level {level:.3f} rad", table)
        console.print(f"{len(table)} observations pass the level; written to {folder}")


class Scan:
    """Varies each quantity of one observation; the joint's `target` (rad) is not limited."""

    def __init__(self, policy: Policy, joint: int, observation: Array, box: ObservationBox) -> None:
        self._policy, self._joint, self._box = policy, joint, box
        self._units = RobotUnits.of(policy.robot, policy.observation_names)
        self._present = self._units.quantities(observation)
        self.target = float(self._targets(0, self._present[:1])[0])

    def passes(self, level: float) -> pd.DataFrame:
        """Finds the nearest value of each quantity at which the target passes a level (rad)."""
        rows = []
        for index, entry in enumerate(entries_of(self._box.names)):
            values, present = self._values(index, entry.group), self._present[index]
            value = self._nearest_pass(index, values, level, counted=entry.group in COUNTED)
            if value is not None:
                share = abs(value - present) / np.ptp(values)
                target = float(self._targets(index, np.array([value]))[0])
                rows.append((entry.symbol, present, value, entry.unit, share, target))
        table = pd.DataFrame(rows, columns=COLUMNS)
        return table.sort_values("share of range", kind="stable", ignore_index=True)

    @styled
    def figure(self, table: pd.DataFrame, level: float) -> Figure:
        """Draws the target over the quantities that pass the level with the least change."""
        figure, axes = subplots(2, N_DRAWN // 2, figsize=(2 * COLUMN_WIDTH, 3.6), sharey=True)
        entries = {entry.symbol: i for i, entry in enumerate(entries_of(self._box.names))}
        for axis, row in zip(axes.flat, table.to_dict("records"), strict=False):
            index = entries[row["observation"]]
            values = self._values(index, entries_of(self._box.names)[index].group)
            axis.plot(values, self._targets(index, values), color="#0072B2")
            axis.axhline(level, color="#828b96", linestyle="--")
            axis.plot(row["value"], self.target, "o", color="black")
            axis.plot(row["passes at"], row["target (rad)"], "o", color="#c75300")
            axis.set_xlabel(f"{row['observation']} ({row['unit'] or '1'})")
        for axis in axes.flat[len(table) :]:
            axis.set_axis_off()
        figure.supylabel("target (rad)")
        return figure

    def _targets(self, index: int, values: Array) -> Array:
        """Returns the joint's targets (k; rad) with other values (k) of one quantity."""
        quantities = np.tile(self._present, (len(values), 1))
        quantities[:, index] = values
        actions = self._policy(self._units.observed(quantities))
        return self._policy.robot.joint_targets(actions)[:, self._joint]

    def _values(self, index: int, group: str) -> Array:
        """Returns the values of a quantity to try, ascending, with its present value."""
        present = self._present[index]
        low, high = min(self._box.lower[index], present), max(self._box.upper[index], present)
        if group == "machine state":
            return np.array([present])
        if group in COUNTED:
            return np.arange(np.rint(low), high + 0.5)
        return np.unique(np.append(np.linspace(low, high, N_VALUES), present))

    def _nearest_pass(
        self, index: int, values: Array, level: float, *, counted: bool
    ) -> float | None:
        """Returns the nearest value of a quantity beyond the level, or None."""
        is_beyond = self.target > level
        passing = np.flatnonzero((self._targets(index, values) > level) != is_beyond)
        start = int(np.argmin(np.abs(values - self._present[index])))
        # On each side, bracket the level by the first value beyond it and the value before.
        pairs = [(first, first + 1) for first in passing[passing < start][-1:]]
        pairs += [(first, first - 1) for first in passing[passing > start][:1]]
        if not pairs:
            return None
        after, before = values[np.array(pairs).T]
        for _ in range(0 if counted else N_BISECTIONS):
            middle = 0.5 * (before + after)
            passed = (self._targets(index, middle) > level) != is_beyond
            after, before = np.where(passed, middle, after), np.where(passed, before, middle)
        return float(after[np.argmin(np.abs(after - self._present[index]))])
