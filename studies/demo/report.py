"""The demo's report: one HTML page, figures inside, replays beside it."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from models.a1 import robot
from models.files import write_atomically
from models.policies.neural import NeuralPolicy
from models.policies.policy import Policy
from models.policies.symbolic import SymbolicPolicy
from models.task.gait import Gait
from studies.distillation.formulas import readable_formula
from studies.pages import inline_image, page_template

TEMPLATES = Path(__file__).parent / "templates"


def write_report(
    folder: Path,
    *,
    gait: Gait,
    expert: NeuralPolicy,
    students: Mapping[str, Policy],
    r2: pd.DataFrame,
    standalone: pd.DataFrame,
    minutes: float,
) -> None:
    """Writes `report.html` from what the demo left in its folder."""
    symbolic = students.get("symbolic")
    formulas = []
    if isinstance(symbolic, SymbolicPolicy):
        formulas = [
            (joint, formula.length, readable_formula(formula, expert.observation_names))
            for joint, formula in zip(robot.JOINTS, symbolic.expressions, strict=True)
        ]
    page = page_template(TEMPLATES, "report.html").render(
        gait=gait,
        n_observations=len(expert.observation_names),
        r2=r2,
        standalone=standalone,
        reward_figure=inline_image(folder / "reward.png"),
        gait_figures=[
            (name, inline_image(folder / f"{name}_gait.png"), f"{name}_replay.html")
            for name in ("expert", "symbolic")
        ],
        formulas=formulas,
        minutes=minutes,
    )
    write_atomically(folder / "report.html", page)
