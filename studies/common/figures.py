"""The look of the project's figures, and how they are written."""

import io
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axis import Axis
from matplotlib.category import StrCategoryFormatter
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import FixedFormatter, FuncFormatter

from glassgait.models.files import write_atomically

COLUMN_WIDTH = 3.5
"""Width of a column of the paper (inches)."""

STYLE: dict[Any, Any] = {
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.labelsize": 8,
    "legend.fontsize": 7,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "0.9",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "legend.frameon": False,
    "figure.constrained_layout.use": True,
    "pdf.fonttype": 42,
    "savefig.dpi": 200,
}

styled = mpl.rc_context(STYLE)
"""Decorates a function that draws a figure, so that the look is the project's there alone."""


def subplots(n_rows: int = 1, n_columns: int = 1, **options: Any) -> tuple[Figure, Any]:
    """Makes a figure and its axes as pyplot's `subplots` does, without pyplot's global state.

    Args:
        n_rows: Rows of axes.
        n_columns: Columns of axes.
        options: `figsize` of the figure (inches), and what `Figure.subplots` takes.
    """
    figure = Figure(figsize=options.pop("figsize", None))
    return figure, figure.subplots(n_rows, n_columns, **options)


@styled
def save_figure(figure: Figure, stem: Path, extensions: tuple[str, ...] = ("png", "pdf")) -> None:
    """Writes a figure as `<stem>.png` and `<stem>.pdf`.

    A dollar sign in a title, a label or a legend is one: names are no mathematics.
    """
    _take_names_as_text(figure)
    for extension in extensions:
        buffer = io.BytesIO()
        # No date inside: equal runs give equal files.
        metadata = {"CreationDate": None} if extension == "pdf" else {"Software": None}
        figure.savefig(buffer, format=extension, metadata=metadata)
        write_atomically(stem.with_name(f"{stem.name}.{extension}"), buffer.getvalue())


def _take_names_as_text(figure: Figure) -> None:
    axes = [axis for own in figure.axes for axis in (own.xaxis, own.yaxis)]
    # Matplotlib writes the powers of ten of a logarithmic axis as mathematics.
    powers = {
        text
        for axis in axes
        if not _is_named(axis)
        for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks())
        for text in tick.findobj(Text)
    }
    for text in figure.findobj(Text):
        if isinstance(text, Text) and text not in powers:
            text.set_parse_math(False)


def _is_named(axis: Axis) -> bool:
    """Returns whether somebody gave the labels of the ticks, rather than matplotlib."""
    given = (FixedFormatter, FuncFormatter, StrCategoryFormatter)
    return isinstance(axis.get_major_formatter(), given)
