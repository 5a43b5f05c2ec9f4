"""Tables on the terminal and in CSV and Markdown files."""

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

HALF = " ±"
"""Suffix of the title of a column with half the widths of the intervals of another column."""


def print_table(title: str, frame: pd.DataFrame) -> None:
    """Prints a table on the terminal, with intervals beside their means."""
    table, frame = Table(title=title, title_justify="left"), joined(frame)
    for column in frame.columns:
        numeric = pd.api.types.is_numeric_dtype(frame[column])
        table.add_column(str(column), justify="right" if numeric else "left", overflow="fold")
    for row in frame.itertuples(index=False):
        table.add_row(*map(format_cell, row))
    console.print(table)


def write_table(frame: pd.DataFrame, stem: Path) -> None:
    """Writes a table as `<stem>.csv` in full precision, and as `<stem>.md` in rounded numbers."""
    write_atomically(stem.with_name(f"{stem.name}.csv"), frame.to_csv(index=False))
    write_atomically(stem.with_name(f"{stem.name}.md"), to_markdown(frame))


def write_metrics(values: Any, path: Path) -> None:
    """Writes metrics as JSON with sorted keys, so that equal runs give equal files."""
    write_atomically(path, json.dumps(values, indent=2, sort_keys=True) + "\n")


def json_records(table: pd.DataFrame) -> list[dict[Hashable, Any]]:
    """Returns the rows of a table for JSON, with null in place of NaN."""
    return table.astype(object).where(table.notna(), None).to_dict(orient="records")


def joined(frame: pd.DataFrame) -> pd.DataFrame:
    """Appends the numbers of each column `x ±` to those of the column `x`, unless they are NaN."""
    halves = [str(name) for name in frame.columns if str(name).endswith(HALF)]
    texts = {}
    for name in halves:
        mean = name.removesuffix(HALF)
        pairs = zip(frame[mean], frame[name], strict=True)
        texts[mean] = [pair[0] if np.isnan(pair[1]) else _with_half(*pair) for pair in pairs]
    return frame.assign(**texts).drop(columns=halves)


def _with_half(mean: float, half: float) -> str:
    digits = 3 if abs(mean) < 100 else 0
    return f"{mean:,.{digits}f}{HALF} {half:,.{digits}f}"


def to_markdown(frame: pd.DataFrame) -> str:
    """Formats a table in Markdown."""
    frame = joined(frame)
    rows = [map(str, frame.columns), ["---"] * len(frame.columns)]
    rows += [map(format_cell, row) for row in frame.itertuples(index=False)]
    # Escape characters that end a cell or start code or HTML.
    escaped = (
        [re.sub(r"[\\|`<]", r"\\\g<0>", " ".join(cell.splitlines())) for cell in row]
        for row in rows
    )
    return "".join(f"| {' | '.join(row)} |\n" for row in escaped)


def format_cell(value: Any) -> str:
    """Formats a cell for reading."""
    if not isinstance(value, float):
        return str(value)
    if np.isnan(value):
        return "–"
    if abs(value) < 0.1:
        return f"{value:.3g}"
    return f"{value:,.3f}" if abs(value) < 100 else f"{value:,.0f}"
