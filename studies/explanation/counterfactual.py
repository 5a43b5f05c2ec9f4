"""`glassgait explain counterfactual`: the value of one observation at which an action changes.

Each observation is varied by itself, over its operating range, while all others stay as they are.
"""

from dataclasses import field
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
import pandas as pd
from annotated_types import Ge
from matplotlib.figure import Figure

from glassgait.diagrams.commands import FixedCommand
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
from glassgait.models.task.observation import entries_of, symbols_of
from glassgait.studies.common.console import console
from glassgait.studies.common.figures import COLUMN_WIDTH, save_figure, styled, subplots
from glassgait.studies.common.tables import print_table, write_table
from glassgait.studies.distillation.students.library import OnePolicy

N_VALUES = 401
"""Values of an observation that are tried, evenly over its range."""

N_BISECTIONS = 30
N_DRAWN = 6

COLUMNS = pd.Index(["observation", "value", "passes at", "unit", "share of range", "target (rad)"])


@checked
class ExplainCounterfactual(OnePolicy):
    """Find the value of each observation at which a joint's target passes a level.

    Attributes:
        joint: The joint.
        level: Level of the joint's target (rad); by default 0.1 rad above its target at the step.
        step: Control step of the rollout that is varied.
        command: Commanded speed, yaw rate and rhythm.
        box: File of the operating box; the gait's shipped one by default.
        seed: Seed of the sensors' noise.
        output: Folder of the results; by default
            runs/explain/counterfactual/<gait>/<policy>_<joint>_<step>.
    """

    title: ClassVar[str] = "explain counterfactual"

    joint: str = "FR_calf"
    level: float | None = None
    step: Annotated[int, Ge(0)] = 280
    command: FixedCommand = field(default_factory=lambda: FixedCommand(speed=0.5))
    box: Path | None = None
    seed: Seed = 0
    output: Path | None = None

    def run(self) -> None:
        """Rolls out, scans each observation, and writes the table and the figure."""
        found, name = self.find()
        gait, joint, controller = found.gait, joint_index(self.joint), found.controller(name)
        box = (
            load_box(self.box, gait, found.robot) if self.box else operating_box(gait, found.robot)
        )

        # Take the observation of one moment.
        diagram = MakeLocomotion(gait, Scenario(command=self.command), policy=controller)
        rollout = record(make_simulator(diagram, seed=self.seed), self.step + 1)
        if len(rollout.time) <= self.step:
            raise InputError(
                f"--step {self.step}: the robot falls at step {len(rollout.time) - 1}; name an "
                "earlier step"
            )
        observation = rollout["observations"][self.step]
        was = float(targets(controller.policy, joint, observation))
        level = was + 0.1 if self.level is None else self.level

        # Report the observations that change the target, the nearest first.
        table = passes(controller.policy, joint, observation, level, box)
        title = f"{self.joint} at step {self.step}: target {was:.3f} rad, level {level:.3f} rad"
        folder = self.output or found.output(self.title) / (
            f"{Path(name).stem}_{self.joint}_{self.step}"
        )
        write_table(table, folder / "counterfactual")
        drawn = passes_figure(controller.policy, joint, observation, level, box, table)
        save_figure(drawn, folder / "counterfactual")
        print_table(title, table)
        console.print(f"{len(table)} observations pass the level; written to {folder}")


def targets(policy: Policy, joint: int, observations: Array) -> Array:
    """Returns the joint's targets (...; rad) of observations (..., n), before limits."""
    return policy.robot.joint_targets(policy(observations))[..., joint]


def passes(
    policy: Policy, joint: int, observation: Array, level: float, box: ObservationBox
) -> pd.DataFrame:
    """Finds the nearest value of each observation at which a joint's target passes a level.

    The state of the reward machine is held.

    Args:
        policy: The policy.
        joint: Index of the joint.
        observation: The observation that is varied (n).
        level: The level (rad).
        box: The range of each observation.

    Returns:
        A row for each observation that passes the level by itself, by increasing share of its
        range. Values are in the robot's units.
    """
    units, rows = RobotUnits.of(policy.robot, policy.observation_names), []
    for index, entry in enumerate(entries_of(policy.observation_names)):
        values = values_of(index, observation, box)
        value = _nearest_pass(policy, joint, observation, level, index, values)
        if value is None:
            continue
        other = varied(observation, index, np.array([value]))[0]
        rows.append(
            {
                "observation": entry.symbol,
                "value": units.quantities(observation)[index],
                "passes at": units.quantities(other)[index],
                "unit": entry.unit,
                "share of range": abs(value - observation[index]) / np.ptp(values),
                "target (rad)": float(targets(policy, joint, other)),
            }
        )
    table = pd.DataFrame(rows, columns=COLUMNS)
    return table.sort_values("share of range", kind="stable", ignore_index=True)


def values_of(index: int, observation: Array, box: ObservationBox) -> Array:
    """Returns the ascending values of an observation that are tried, its present one included.

    Counts take whole numbers only, and the state of the reward machine its present value.
    """
    entry, here = entries_of(box.names)[index], observation[index]
    low, high = min(box.lower[index], here), max(box.upper[index], here)
    if entry.group == "machine state":
        return observation[[index]]
    if entry.group in COUNTED:
        return np.arange(np.rint(low / entry.factor), high / entry.factor + 0.5) * entry.factor
    return np.unique(np.append(np.linspace(low, high, N_VALUES), here))


def varied(observation: Array, index: int, values: Array) -> Array:
    """Returns observations (k, n) that differ in one entry, which takes the values (k)."""
    several = np.tile(observation, (len(values), 1))
    several[:, index] = values
    return several


def _nearest_pass(
    policy: Policy, joint: int, observation: Array, level: float, index: int, values: Array
) -> float | None:
    """Returns the nearest value of an observation beyond the level; None without one."""
    beyond = targets(policy, joint, varied(observation, index, values)) > level
    here = int(np.argmin(np.abs(values - observation[index])))
    passing = np.flatnonzero(beyond != beyond[here])
    # On either side, the first value beyond the level and its neighbour before it.
    pairs = [(own, own + 1) for own in passing[passing < here][-1:]]
    pairs += [(own, own - 1) for own in passing[passing > here][:1]]
    if not pairs:
        return None
    after, before = values[np.array(pairs).T]
    is_counted = entries_of(policy.observation_names)[index].group in COUNTED
    for _ in range(0 if is_counted else N_BISECTIONS):
        middle = 0.5 * (before + after)
        is_beyond = targets(policy, joint, varied(observation, index, middle)) > level
        passed = is_beyond != beyond[here]
        after, before = np.where(passed, middle, after), np.where(passed, before, middle)
    return float(after[np.argmin(np.abs(after - observation[index]))])


@styled
def passes_figure(
    policy: Policy,
    joint: int,
    observation: Array,
    level: float,
    box: ObservationBox,
    table: pd.DataFrame,
) -> Figure:
    """Draws the target over those observations that pass the level by the least change."""
    units, symbols = RobotUnits.of(policy.robot, box.names), symbols_of(box.names)
    drawn, axes = subplots(2, N_DRAWN // 2, figsize=(2 * COLUMN_WIDTH, 3.6), sharey=True)
    for axis, row in zip(axes.flat, table.to_dict("records"), strict=False):
        index = symbols.index(row["observation"])
        several = varied(observation, index, values_of(index, observation, box))
        quantities = units.quantities(several)[:, index]
        axis.plot(quantities, targets(policy, joint, several), color="#0072B2")
        axis.axhline(level, color="#828b96", linestyle="--")
        axis.plot(row["value"], targets(policy, joint, observation), "o", color="black")
        axis.plot(row["passes at"], row["target (rad)"], "o", color="#c75300")
        axis.set_xlabel(
            f"{row['observation']} ({row['unit']})" if row["unit"] else row["observation"]
        )
    for axis in axes.flat[len(table) :]:
        axis.set_axis_off()
    for axis in axes[:, 0]:
        axis.set_ylabel("target (rad)")
    return drawn
