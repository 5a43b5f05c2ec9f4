"""The table of the shipped experts' training, from their records."""

from collections.abc import Iterable
from pathlib import Path

import pandas as pd

from glassgait.models.files import read_yaml

PAPER_CONTROL_STEPS = 36.9e6
"""The paper's budget for a gait: 1,500 updates of 1,024 robots and 24 steps."""


def training_table(records: Iterable[Path]) -> pd.DataFrame:
    """Lists what each expert's training took, and how it ended.

    Args:
        records: Records that training wrote (<gait>.yaml).
    """
    rows = []
    for path in records:
        record = read_yaml(path)
        rows.append(
            {
                "gait": record["gait"],
                "control steps": f"{record['control_steps'] / 1e6:.1f} M",
                "of the paper's": f"{record['control_steps'] / PAPER_CONTROL_STEPS:.0%}",
                "simulated": f"{record['simulated_hours']:.0f} h",
                "wall time": f"{record['wall_minutes']:.0f} min",
                "rhythm kept": f"{record['final']['rhythm']:.2f}",
                "reward a step": f"{record['final']['reward']:.2f}",
                "plain reward a step": f"{record['final']['plain_reward']:.4f}",
            }
        )
    return pd.DataFrame(rows)
