"""`glassgait explain interventions`: whether what a page of formulas says is true of the robot."""

from pathlib import Path
from typing import Annotated, ClassVar

import pandas as pd
from annotated_types import Ge
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.settings import Count, Seed, checked
from glassgait.models.task.gait import Gait
from glassgait.studies.common.console import console, say
from glassgait.studies.common.experiment import REPORTED_SEEDS
from glassgait.studies.common.figures import COLUMN_WIDTH, save_figure, styled, subplots
from glassgait.studies.common.rollouts import RolloutConfig
from glassgait.studies.common.run import open_run
from glassgait.studies.common.tables import json_records, print_table, write_metrics, write_table
from glassgait.studies.distillation.students import OnePolicy, student_title
from glassgait.studies.explanation.interventions.claims import derive_claims, refuse_too_few
from glassgait.studies.explanation.interventions.study import Examiner, readable_table
from glassgait.studies.explanation.interventions.terms import readable_terms
from glassgait.studies.explanation.interventions.walks import Walk, walk

HOLDS, FAILS, PREDICTED = "#0072B2", "#C75300", "0.35"
"""Colours of claims that hold, of those that do not, and of what was predicted."""

TITLES = {
    "joint": "The term sees one standard deviation more of its input",
    "following": "The term is replaced by its mean",
}
LABELS = {
    "joint": "movement of its joint (rad)",
    "following": "by how much more robots miss their command (m/s or rad/s)",
}
"""What stands above and below the panel of each subject."""

ROW = 0.3
"""Height of a row (inches)."""


@styled
def claims_figure(table: pd.DataFrame, title: str) -> Figure:
    """Draws each claim's predicted effect and the measured one with its 95 % interval, a row each.

    Args:
        table: What `Examiner.examine` returned.
        title: What stands above.
    """
    parts = [part for _, part in table.groupby("subject", sort=False)]
    heights = [len(part) + 1 for part in parts]
    figure, panels = subplots(
        len(parts),
        1,
        figsize=(2 * COLUMN_WIDTH, ROW * sum(heights) + 0.7 * len(parts) + 0.4),
        squeeze=False,
        height_ratios=heights,
    )
    for panel, part in zip(panels[:, 0], parts, strict=True):
        _draw(panel, part)
        panel.set_title(TITLES[part["subject"].iloc[0]])
        panel.set_xlabel(LABELS[part["subject"].iloc[0]])
    figure.legend(handles=_legend(table), loc="outside upper center", ncols=3, title=title)
    return figure


def _draw(panel: Axes, part: pd.DataFrame) -> None:
    panel.axvline(0.0, color="0.6", linewidth=0.8)
    for row, cell in enumerate(part.to_dict(orient="records")):
        color = HOLDS if cell["holds"] else FAILS
        panel.plot(
            cell["predicted"], row, marker="D", color=PREDICTED, markersize=4, fillstyle="none"
        )
        panel.errorbar(
            cell["measured"],
            row,
            xerr=cell["high"] - cell["measured"],
            fmt="o" if cell["holds"] else "X",
            color=color,
            markersize=4,
            elinewidth=1.2,
            capsize=2,
        )
    panel.set_yticks(range(len(part)), [_label(cell) for cell in part.to_dict(orient="records")])
    panel.set_ylim(len(part) - 0.4, -0.6)
    panel.grid(visible=False, axis="y")


def _label(cell: dict) -> str:
    where = f", state {cell['state']}" if cell["state"] >= 0 else ""
    return f"{cell['joint']}{where}: {cell['term']}"


def _legend(table: pd.DataFrame) -> list[Line2D]:
    style = {"linestyle": "none", "markersize": 4}
    handles = [
        Line2D([], [], marker="D", color=PREDICTED, fillstyle="none", label="predicted", **style),
        Line2D([], [], marker="o", color=HOLDS, label="measured: the claim holds", **style),
    ]
    if not table["holds"].all():
        fails = Line2D([], [], marker="X", color=FAILS, label="measured: it does not", **style)
        handles.append(fails)
    return handles


@checked
class ExplainInterventions(OnePolicy):
    """Test what a policy of formulas says: change a term, and see whether the robot moves so.

    Attributes:
        n_claims: Claims of joints, one a term, the terms that move a target most.
        n_robots: Robots of each walk.
        n_steps: Control steps of each.
        seed: Seed of starts, commands and noise, the same for every walk.
        resume: Continue the run that the folder holds.
        output: Folder of the results; runs/explain/interventions/<gait>/<policy> by default.
    """

    title: ClassVar[str] = "explain interventions"

    n_claims: Count = 8
    n_robots: Annotated[Count, Ge(2)] = 26
    n_steps: Annotated[Count, Ge(2)] = 500
    seed: Seed = REPORTED_SEEDS[0]
    resume: bool = False
    output: Path | None = None

    def run(self) -> None:
        """Derives claims, tests them, and writes how they did."""
        found, name = self.find()
        gait = found.gait
        policy, expert = found.formulas(name), found.expert_of(name)
        stem = Path(name).stem
        folder = self.output or found.output(self.title) / stem
        # Before a folder is claimed: a refusal leaves nothing behind.
        refuse_too_few(len(readable_terms(policy.to_file())), self.n_claims)
        inputs = {"gait": gait.digest(), "policy": policy.digest()}
        inputs |= {"expert": expert.digest()} if expert else {}
        with open_run(folder, study=self.title, settings=self, inputs=inputs, resume=self.resume):
            table, falls = self._test(gait, expert, policy, folder)
            write_table(readable_table(table), folder / "claims")
            metrics = {"claims": json_records(table), "held": int(table["holds"].sum())}
            metrics |= {"tested": len(table), "falls": falls}
            write_metrics(metrics, folder / "metrics.json")
            title = f"{gait.name.capitalize()}, {student_title(stem)}"
            save_figure(claims_figure(table, title), folder / "claims")
        print_table(f"{gait.name}: what {student_title(stem)} says", readable_table(table))
        console.print(f"{metrics['held']} of {metrics['tested']} claims hold; written to {folder}")

    def _test(
        self, gait: Gait, expert: NeuralPolicy | None, policy: FormulaPolicy, folder: Path
    ) -> tuple[pd.DataFrame, int]:
        """Returns what `Examiner.examine` does, and how many robots fall with the formulas."""

        config = RolloutConfig(
            n_robots=self.n_robots, n_steps=self.n_steps, seed=self.seed, n_seeds=1
        )

        def walk_with(edited: FormulaPolicy) -> Walk:
            return walk(gait, expert, edited, config)

        say(f"{gait.name}: walking with the formulas as they are")
        plain = walk_with(policy)
        file = policy.to_file()
        claims = derive_claims(file, plain, self.n_claims)
        return Examiner(policy, plain, walk_with, folder).examine(claims), plain.falls
