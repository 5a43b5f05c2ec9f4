"""How far a training run has come, and its learning curve."""

from dataclasses import dataclass, field

import pandas as pd


@dataclass
class Progress:
    """How far a run has come.

    Attributes:
        update: Updates done.
        seconds: Wall time spent (s), over all parts of an interrupted run.
        curve: The learning curve, a row an update.
    """

    update: int = 0
    seconds: float = 0.0
    curve: list[dict[str, float]] = field(default_factory=list)

    def curve_table(self) -> pd.DataFrame:
        """Returns the learning curve as a table."""
        return pd.DataFrame(self.curve)
