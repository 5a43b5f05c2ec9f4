"""A page of results: text, tables, pictures and replays, as one HTML file and in Markdown."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from markdown_it import MarkdownIt
from markupsafe import Markup

from glassgait.models.files import write_atomically
from glassgait.studies.common.pages import embedded, inline_image, page_template
from glassgait.studies.common.tables import to_markdown

TEMPLATES = Path(__file__).parent / "templates"


@dataclass(frozen=True)
class Table:
    """A table with what stands above it.

    Attributes:
        frame: The table.
        heading: Its heading, or "".
        note: How to read it, in Markdown.
    """

    frame: pd.DataFrame
    heading: str = ""
    note: str = ""


@dataclass(frozen=True)
class Replay:
    """A replay in the page's folder.

    Attributes:
        title: Who moves.
        page: Name of its file.
        strip: Its gait strip, as `strip_data` returns.
    """

    title: str
    page: str
    strip: Mapping[str, Any]


@dataclass(frozen=True)
class Section:
    """A part of a page.

    Attributes:
        title: What it shows.
        number: The paper's number for it, or "".
        note: How to read it, in Markdown.
        points: Sentences of a list.
        tables: The tables.
        replays: Replays in the page's folder, all of one length, which one player plays.
        figures: Pictures (PNG or SVG), each with what it shows.
        texts: Texts that are folded, each with its title.
        wide: Whether a picture takes the page's whole width.
        pending: What is not there yet, or "".
    """

    title: str
    number: str = ""
    note: str = ""
    points: Sequence[str] = ()
    tables: Sequence[Table] = ()
    replays: Sequence[Replay] = ()
    figures: Sequence[tuple[str, Path]] = ()
    texts: Sequence[tuple[str, str]] = ()
    wide: bool = False
    pending: str = ""

    @property
    def heading(self) -> str:
        """Number and title."""
        return f"{self.number}. {self.title}" if self.number else self.title

    @property
    def anchor(self) -> str:
        """What links to the section name it by, in HTML as on a page of Markdown."""
        return re.sub(r"[^\w -]", "", self.heading.lower()).replace(" ", "-")


@dataclass(frozen=True)
class Page:
    """A page.

    Attributes:
        title: Its title.
        lead: What it is of: paragraphs in Markdown.
        sections: Its parts.
    """

    title: str
    lead: Sequence[str]
    sections: Sequence[Section]

    def write(self, folder: Path) -> Path:
        """Writes report.html, with all pictures in it, and report.md; each whole or not at all.

        Returns:
            The path of report.html.
        """
        path = folder / "report.html"
        markdown = MarkdownIt()
        html = page_template(TEMPLATES, "report.html").render(
            page=self,
            inline=inline_image,
            strips=[
                embedded(replay.strip) for section in self.sections for replay in section.replays
            ],
            prose=lambda text: Markup(markdown.renderInline(text)),
        )
        write_atomically(path, html)
        text = page_template(TEMPLATES, "report.md").render(
            page=self, markdown=to_markdown, place=lambda figure: _place(figure, folder)
        )
        write_atomically(folder / "report.md", text)
        return path


def _place(path: Path, folder: Path) -> str:
    """Returns a path from the folder on; that of a file elsewhere whole."""
    resolved, root = path.resolve(), folder.resolve()
    return str(resolved.relative_to(root) if resolved.is_relative_to(root) else resolved)
