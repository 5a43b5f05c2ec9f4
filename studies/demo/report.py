"""The demo's report: one HTML page, figures inside, replays beside it."""

from pathlib import Path

import pandas as pd

from glassgait.models.a1 import robot
from glassgait.models.files import write_atomically
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import StatewiseSymbolicPolicy
from glassgait.models.task.gait import Gait
from glassgait.studies.evaluation.tables import policy_title
from glassgait.studies.pages import inline_image, page_template
from glassgait.studies.students.formula_pages import readable_formula

TEMPLATES = Path(__file__).parent / "templates"


def write_report(
    folder: Path,
    *,
    gait: Gait,
    expert: NeuralPolicy,
    shown: tuple[str, Policy],
    r2: pd.DataFrame,
    standalone: pd.DataFrame,
    minutes: float,
) -> None:
    """Writes `report.html` from what the demo left in its folder.

    Args:
        folder: The demo's folder.
        gait: The gait.
        expert: The expert.
        shown: Kind and policy of the student whose formulas and replay are shown.
        r2: The R² table.
        standalone: The scores alone.
        minutes: What the demo took.
    """
    kind, student = shown
    formulas = []
    if isinstance(student, StatewiseSymbolicPolicy):
        for i, (state, own) in enumerate(zip(gait.states, student.expressions, strict=True)):
            formulas += [
                (
                    f"{joint} in {state}",
                    formula.length,
                    readable_formula(formula, expert.observation_names, i),
                )
                for joint, formula in zip(robot.JOINTS, own, strict=True)
            ]
    page = page_template(TEMPLATES, "report.html").render(
        gait=gait,
        n_observations=len(expert.observation_names),
        r2=r2,
        standalone=standalone,
        reward_figure=inline_image(folder / "reward.png"),
        gait_figures=[
            (
                policy_title(name),
                inline_image(folder / f"{name}_gait.png"),
                f"{name}_replay.html",
            )
            for name in ("expert", kind)
        ],
        title=policy_title(kind),
        formulas=formulas,
        minutes=minutes,
    )
    write_atomically(folder / "report.html", page)
