"""The demo's report: one HTML page that grows, figures inside, replays beside it."""

from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd

from glassgait.models.files import write_atomically
from glassgait.models.formulas.text import write_formula
from glassgait.models.policies.symbolic import StatewiseSymbolicPolicy
from glassgait.models.robots import quadruped
from glassgait.models.task.gait import Gait
from glassgait.studies.common.pages import inline_image, page_template
from glassgait.studies.reproduction.demo.reductions import Reduction

TEMPLATES = Path(__file__).parent / "templates"
REPORT_NAME = "report.html"


@dataclass(frozen=True)
class Replay:
    """A replay in the demo's folder, and its gait diagram.

    Attributes:
        name: What their files begin with.
        title: What the page calls it.
    """

    name: str
    title: str

    @property
    def page(self) -> str:
        """Name of the replay's own page."""
        return f"{self.name}_replay.html"

    @property
    def figure(self) -> str:
        """Name of the gait diagram's picture."""
        return f"{self.name}_gait.png"


@dataclass
class Contents:
    """What the report shows: what is None or empty is not there yet.

    Attributes:
        gait: The gait.
        speed: Forward speed that replays are commanded (m/s).
        n_observations: Number of observations of the expert and its students.
        n_students: Number of students in the end.
        reductions: What is smaller than in the full studies, and what that costs.
        replays: The replays so far.
        standalone: The scores alone.
        return_figure: Picture of return against alternation ratio.
        r2: The R² table of the students so far.
        formulas: The formulas of the student that is shown, as `formula_rows` lists them.
        minutes: What the demo took; the page is complete with it.
    """

    gait: Gait
    speed: float
    n_observations: int
    n_students: int
    reductions: tuple[Reduction, ...]
    replays: list[Replay] = field(default_factory=list)
    standalone: pd.DataFrame | None = None
    return_figure: Path | None = None
    r2: pd.DataFrame | None = None
    formulas: list[tuple[str, int, str]] = field(default_factory=list)
    minutes: float | None = None


def write_report(folder: Path, contents: Contents) -> Path:
    """Writes `report.html`, whole each time, and returns its path.

    Args:
        folder: The demo's folder, with the files of the replays.
        contents: What is there by now.
    """
    path = folder / REPORT_NAME
    page = page_template(TEMPLATES, REPORT_NAME).render(
        **vars(contents),
        figures={replay.name: inline_image(folder / replay.figure) for replay in contents.replays},
        reward=contents.return_figure and inline_image(contents.return_figure),
    )
    write_atomically(path, page)
    return path


def formula_rows(gait: Gait, student: StatewiseSymbolicPolicy) -> list[tuple[str, int, str]]:
    """Lists joint and state, length in nodes and text of every formula."""
    return [
        (
            f"{joint} in {state}",
            formula.length,
            write_formula(formula, student.vocabulary.symbols),
        )
        for i, (state, own) in enumerate(zip(gait.states, student.expressions, strict=True))
        for joint, formula in zip(quadruped.JOINTS, own, strict=True)
    ]
