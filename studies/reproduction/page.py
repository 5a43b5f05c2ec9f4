"""Writes results as one HTML page: text, tables, pictures and replays."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from glassgait.models.files import write_atomically
from glassgait.studies.common.figures import inline_image, page_template

TEMPLATES = Path(__file__).parent / "templates"


@dataclass(frozen=True)
class Section:
    """A part of a page.

    Attributes:
        number: The paper's number of the table or figure, or "".
        tables: Tables, each after its heading or "".
        replays: Titles of replays, each with its file in the page's folder.
        figures: Captions, each with its picture (PNG or SVG).
    """

    title: str
    number: str = ""
    note: str = ""
    points: Sequence[str] = ()
    tables: Sequence[tuple[str, pd.DataFrame]] = ()
    replays: Sequence[tuple[str, str]] = ()
    figures: Sequence[tuple[str, Path]] = ()
    wide: bool = False


def write_page(folder: Path, title: str, lead: Sequence[str], sections: Sequence[Section]) -> Path:
    """Writes report.html, which holds all pictures, and returns its path."""
    template = page_template(TEMPLATES, "report.html")
    html = template.render(title=title, lead=lead, sections=sections, inline=inline_image)
    write_atomically(folder / "report.html", html)
    return folder / "report.html"
