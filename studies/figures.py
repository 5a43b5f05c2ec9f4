"""The look of the project's figures, and how they are written."""

import io
from pathlib import Path

import matplotlib as mpl
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from models.files import write_atomically
from models.task.observation import unit_of

COLUMN_WIDTH = 3.5
"""Width of a column of the paper (inches)."""

STYLE = {
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

mpl.use("Agg")
mpl.rcParams.update(STYLE)


def label_with_unit(name: str) -> str:
    """Labels an axis with an observation's name, its unit below."""
    return f"{name}\n({unit_of(name)})"


def save_figure(figure: Figure, stem: Path, extensions: tuple[str, ...] = ("png", "pdf")) -> None:
    """Writes a figure as `<stem>.png` and `<stem>.pdf`, and closes it."""
    for extension in extensions:
        buffer = io.BytesIO()
        # No date inside: equal runs give equal files.
        metadata = {"CreationDate": None} if extension == "pdf" else {"Software": None}
        figure.savefig(buffer, format=extension, metadata=metadata)
        write_atomically(stem.with_name(f"{stem.name}.{extension}"), buffer.getvalue())
    plt.close(figure)
