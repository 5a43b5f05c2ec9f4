"""Tables: on the terminal, and as CSV and Markdown files."""

import json
import re
from collections.abc import Hashable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from glassgait.models.files import write_atomically
from glassgait.studies.common.console import console

SHORT = 24
"""Characters of a cell that is not to be broken in lines."""


def print_table(title: str, frame: pd.DataFrame) -> None:
    """Prints a table on the terminal: one below the other where columns have no room there."""
    anywhere = console.options.update(max_width=10_000)
    needed = Measurement.get(console, anywhere, _flat(title, frame, unbroken=True)).minimum
    if needed > console.width:
        console.print(_upright(title, frame))
    else:
        console.print(_flat(title, frame))


def _flat(title: str, frame: pd.DataFrame, *, unbroken: bool = False) -> Table:
    """Makes a table of rows; to be measured, with short cells that are not broken."""
    table = Table(title=title, title_justify="left")
    for column in frame.columns:
        numeric = pd.api.types.is_numeric_dtype(frame[column])
        table.add_column(str(column), justify="right" if numeric else "left")
    for row in frame.itertuples(index=False):
        cells = [format_cell(value) for value in row]
        if unbroken:
            cells = [cell.replace(" ", "_") if len(cell) <= SHORT else cell for cell in cells]
        table.add_row(*cells)
    return table


def _upright(title: str, frame: pd.DataFrame) -> Table:
    """Makes a table that has a block for each row: its first cell, and below it all others."""
    table = Table(title=title, title_justify="left", show_header=False)
    first, *others = (str(column) for column in frame.columns)
    for row in frame.itertuples(index=False):
        name, *cells = (format_cell(value) for value in row)
        table.add_row(first, Text(name, style="bold"))
        for column, cell in zip(others, cells, strict=True):
            table.add_row(Text(column, style="dim"), cell)
        table.add_section()
    return table


def write_table(frame: pd.DataFrame, stem: Path) -> None:
    """Writes a table as `<stem>.csv`, in full precision, and `<stem>.md`, rounded."""
    write_atomically(stem.with_name(f"{stem.name}.csv"), frame.to_csv(index=False))
    write_atomically(stem.with_name(f"{stem.name}.md"), to_markdown(frame))


def write_metrics(values: Any, path: Path) -> None:
    """Writes metrics as JSON, keys sorted, so that equal runs give equal files."""
    write_atomically(path, json.dumps(values, indent=2, sort_keys=True) + "\n")


def json_records(table: pd.DataFrame) -> list[dict[Hashable, Any]]:
    """Returns the rows of a table for JSON, which has no NaN: null stands in its place."""
    return table.astype(object).where(table.notna(), None).to_dict(orient="records")


def to_markdown(frame: pd.DataFrame) -> str:
    """Formats a table in Markdown."""
    lines = [
        "| " + " | ".join(escape_markdown(str(column)) for column in frame.columns) + " |",
        "|" + "|".join(" --- " for _ in frame.columns) + "|",
    ]
    for row in frame.itertuples(index=False):
        lines.append("| " + " | ".join(escape_markdown(format_cell(cell)) for cell in row) + " |")
    return "\n".join(lines) + "\n"


def to_latex(frame: pd.DataFrame) -> str:
    """Formats a table in LaTeX, for booktabs."""
    cells = frame.map(format_cell)
    return cells.to_latex(index=False, escape=True)


def format_cell(value: Any) -> str:
    """Formats a cell for reading."""
    if isinstance(value, float):
        if np.isnan(value):
            return "–"
        return (
            f"{value:.3g}"
            if abs(value) < 0.1
            else f"{value:,.3f}"
            if abs(value) < 100
            else f"{value:,.0f}"
        )
    return str(value)


def escape_markdown(text: str) -> str:
    """Escapes what would end a cell, or be read as code or HTML, in a table in Markdown."""
    return re.sub(r"[\\|`<]", r"\\\g<0>", " ".join(text.splitlines()))
