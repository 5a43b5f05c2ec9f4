"""Style and output of figures and HTML pages, and the gait diagram."""

import base64
import io
import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import jinja2
import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from glassgait.diagrams.rollout import Rollout
from glassgait.models.files import write_atomically
from glassgait.models.robots import quadruped
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.drawing import ink_on, state_colors
from glassgait.models.task.gait import Gait
from glassgait.studies.common.tables import format_cell, joined

COLUMN_WIDTH = 3.5  # width of a column of the paper (inches)

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
    # Names of gaits and files may contain dollar signs.
    "text.parse_math": False,
    "pdf.fonttype": 42,
    "savefig.dpi": 200,
}

styled = mpl.rc_context(STYLE)
"""Decorator that applies the style in a drawing function, without changing global state."""


def subplots(n_rows: int = 1, n_columns: int = 1, **options: Any) -> tuple[Figure, Any]:
    """Makes a figure and axes like pyplot's `subplots`, but without pyplot's global state.

    The options are `figsize` (inches) and those of `Figure.subplots`.
    """
    figure = Figure(figsize=options.pop("figsize", None))
    return figure, figure.subplots(n_rows, n_columns, **options)


@styled
def save_figure(figure: Figure, stem: Path, extensions: tuple[str, ...] = ("png", "pdf")) -> None:
    """Writes a figure as `<stem>.png` and `<stem>.pdf`."""
    for extension in extensions:
        buffer = io.BytesIO()
        # Omit the date, so that equal runs give equal files.
        metadata = {"CreationDate": None} if extension == "pdf" else {"Software": None}
        figure.savefig(buffer, format=extension, metadata=metadata)
        write_atomically(stem.with_name(f"{stem.name}.{extension}"), buffer.getvalue())


@styled
def gait_figure(rollout: Rollout, gait: Gait, title: str, seconds: float = 2.0) -> Figure:
    """Draws foot contacts over time, with RM states as bands."""
    figure, axes = subplots(figsize=(2 * COLUMN_WIDTH, 1.5))
    last = rollout.time[-1]
    draw_gait(axes, rollout, gait)
    axes.set_xlim(max(0.0, last - seconds), last)
    axes.set_title(title)
    return figure


def draw_gait(axes: Axes, rollout: Rollout, gait: Gait) -> None:
    """Draws the gait diagram of a whole rollout."""
    # Draw RM states as bands behind the contacts.
    states, colors = rollout["rm_state"].argmax(axis=1), state_colors(gait)
    for start, stop in _runs(states):
        axes.axvspan(
            rollout.time[start],
            rollout.time[start] + (stop - start) * CONTROL_PERIOD,
            color=colors[states[start]],
            alpha=0.25,
            linewidth=0,
        )

    # Draw each contact as a bar in the leg's row.
    for row in range(quadruped.N_LEGS):
        touches = rollout["foot_contact"][:, row] > 0.5
        bars = [
            (rollout.time[start], (stop - start) * CONTROL_PERIOD)
            for start, stop in _runs(touches)
            if touches[start]
        ]
        axes.broken_barh(bars, (row - 0.35, 0.7), color="0.15", linewidth=0)
    axes.set_yticks(range(quadruped.N_LEGS), quadruped.LEGS)
    axes.set(xlabel="time (s)", ylim=(quadruped.N_LEGS - 0.4, -0.6))
    axes.grid(visible=False)
    named = zip(gait.states, colors, strict=True)
    states_shown = [Patch(color=color, alpha=0.25, label=name) for name, color in named]
    handles = [Patch(color="0.15", label="contact"), *states_shown]
    axes.legend(handles=handles, loc="center left", bbox_to_anchor=(1.0, 0.5))


def _runs(values: np.ndarray) -> list[tuple[int, int]]:
    """Returns the intervals [start, stop) of equal values."""
    edges = np.flatnonzero(np.diff(values)) + 1
    return list(pairwise([0, *edges.tolist(), len(values)]))


def page_template(folder: Path, name: str) -> jinja2.Template:
    """Loads a template from a study's folder; it may extend the shared `page.html`."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([folder, Path(__file__).parent / "templates"]),
        autoescape=jinja2.select_autoescape(["html"]),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"cell": format_cell, "joined": joined}
    environment.filters["minus"] = lambda text: re.sub(r"-(?=[0-9])", "−", text)
    environment.globals["chip"] = lambda color: f"background: {color}; color: {ink_on(color)}"
    return environment.get_template(name)


def inline_image(path: Path) -> str:
    """Encodes a picture as a data URL."""
    mime = {".png": "image/png", ".svg": "image/svg+xml", ".gif": "image/gif"}[path.suffix]
    return f"data:{mime};base64,{base64.b64encode(path.read_bytes()).decode()}"
