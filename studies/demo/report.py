"""The demo's report: one HTML page, figures inside, replays beside it."""

import base64
from collections.abc import Mapping
from pathlib import Path

import jinja2
import pandas as pd

from models.a1 import robot
from models.files import write_atomically
from models.policies.neural import NeuralPolicy
from models.policies.policy import Policy
from models.policies.symbolic import SymbolicPolicy
from models.task.gait import Gait
from studies.distillation.formulas import readable_formula
from studies.tables import format_cell

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
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES), autoescape=True, undefined=jinja2.StrictUndefined
    )
    environment.filters["cell"] = format_cell
    symbolic = students.get("symbolic")
    formulas = []
    if isinstance(symbolic, SymbolicPolicy):
        formulas = [
            (joint, formula.length, readable_formula(formula, expert.observation_names))
            for joint, formula in zip(robot.JOINTS, symbolic.expressions, strict=True)
        ]
    page = environment.get_template("report.html").render(
        gait=gait,
        n_observations=len(expert.observation_names),
        r2=r2,
        standalone=standalone,
        reward_figure=_inline(folder / "reward.png"),
        gait_figures=[
            (name, _inline(folder / f"{name}_gait.png"), f"{name}_replay.html")
            for name in ("expert", "symbolic")
        ],
        formulas=formulas,
        minutes=minutes,
    )
    write_atomically(folder / "report.html", page)


def _inline(path: Path) -> str:
    return "data:image/png;base64," + base64.b64encode(path.read_bytes()).decode()
