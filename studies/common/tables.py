"""Tables: on the terminal, and as CSV and Markdown files."""

import json
import re
from collections.abc import Hashable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from rich.table import Table

from glassgait.models.files import write_atomically
from glassgait.studies.common.console import console


def print_table(title: str, frame: pd.DataFrame) -> None:
    """Prints a table on the terminal."""
    table = Table(title=title, title_justify="left")
    for column in frame.columns:
        numeric = pd.api.types.is_numeric_dtype(frame[column])
        table.add_column(str(column), justify="right" if numeric else "left", overflow="fold")
    for row in frame.itertuples(index=False):
        table.add_row(*map(format_cell, row))
    console.print(table)


def write_table(frame: pd.DataFrame, stem: Path) -> None:
    """Writes a table as `<stem>.csv`, in full precision, and `<stem>.md`, rounded."""
    write_atomically(stem.with_name(f"{stem.name}.csv"), frame.to_csv(index=False))
    write_atomically(stem.with_name(f"{stem.name}.md"), to_markdown(frame))


def write_metrics(values: Any, path: Path) -> None:
    """Writes metrics as JSON, keys sorted, so that equal runs give equal files."""
    write_atomically(path, json.dumps(values, indent=2, sort_keys=True) + "\n")


def json_records(table: pd.DataFrame) -> list[dict[Hashable, Any]]:
    """Returns the rows of a table for JSON, with null in place of NaN."""
    return table.astype(object).where(table.notna(), None).to_dict(orient="records")


def to_markdown(frame: pd.DataFrame) -> str:
    """Formats a table in Markdown."""
    rows = [map(str, frame.columns), ["---"] * len(frame.columns)]
    rows += [map(format_cell, row) for row in frame.itertuples(index=False)]
    # Escape what would end a cell, or begin code or HTML.
    escaped = (
        [re.sub(r"[\\|`<]", r"\\\g<0>", " ".join(cell.splitlines())) for cell in row]
        for row in rows
    )
    return "".join(f"| {' | '.join(row)} |\n" for row in escaped)


def to_latex(frame: pd.DataFrame) -> str:
    """Formats a table in LaTeX, for booktabs."""
    return frame.map(format_cell).to_latex(index=False, escape=True)


def format_cell(value: Any) -> str:
    """Formats a cell for reading."""
    if not isinstance(value, float):
        return str(value)
    if np.isnan(value):
        return "–"
    if abs(value) < 0.1:
        return f"{value:.3g}"
    return f"{value:,.3f}" if abs(value) < 100 else f"{value:,.0f}"
