"""Tables of pushes: which shares of robots survive, and the greatest push that all survive."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from glassgait.models.arrays import Array
from glassgait.studies.distillation.students.registry import policy_title
from glassgait.studies.evaluation.pushes.basin import PushGrid
from glassgait.studies.evaluation.robustness.tables import wilson_interval


@dataclass(frozen=True)
class Basin:
    """What one policy survives.

    Attributes:
        grid: The pushes.
        survived: Robots that survived, by direction and speed (n_directions, n_speeds).
        failures: Robots that did not, by how they ended.
    """

    grid: PushGrid
    survived: Array
    failures: Mapping[str, int]

    @property
    def shares(self) -> Array:
        """Shares of phases in which robots survive (n_directions, n_speeds)."""
        return self.survived / self.grid.n_phases

    @property
    def all_up_to(self) -> float:
        """The greatest speed up to which every push is survived (m/s); 0 if there is none."""
        return self._up_to(self.shares.min(axis=0) >= 1.0)

    @property
    def half_up_to(self) -> float:
        """The greatest speed up to which at least half of the pushes are survived (m/s)."""
        return self._up_to(self.shares.mean(axis=0) >= 0.5)

    def _up_to(self, holds: Array) -> float:
        count = len(holds) if holds.all() else int(np.argmin(holds))
        return float(self.grid.speeds[count - 1]) if count else 0.0


def summary_table(basins: Mapping[str, Basin]) -> pd.DataFrame:
    """Makes a row of each policy."""
    rows = []
    for policy, basin in basins.items():
        n_pushes = int(np.prod(basin.grid.shape))
        survived = int(basin.survived.sum())
        low, high = wilson_interval(survived, n_pushes)
        weakest = int(basin.shares.mean(axis=1).argmin())
        ends = sorted(basin.failures.items(), key=lambda end: -end[1])
        row: dict[str, Any] = {
            "policy": policy_title(policy),
            "all survived up to (m/s)": basin.all_up_to,
            "half survived up to (m/s)": basin.half_up_to,
            "survived": f"{survived} of {n_pushes}",
            "share": survived / n_pushes,
            "95 % from": low,
            "95 % to": high,
            "weakest direction": f"{np.degrees(basin.grid.directions[weakest]):.0f}°",
            "how the others ended": ", ".join(
                f"{name.replace('_', ' ')} {count}" for name, count in ends if count
            )
            or "–",
        }
        rows.append(row)
    return pd.DataFrame(rows)


def push_table(basins: Mapping[str, Basin]) -> pd.DataFrame:
    """Makes a row of each policy, direction and speed."""
    rows = []
    for policy, basin in basins.items():
        for i, direction in enumerate(basin.grid.directions):
            for j, speed in enumerate(basin.grid.speeds):
                survived = int(basin.survived[i, j])
                low, high = wilson_interval(survived, basin.grid.n_phases)
                rows.append(
                    {
                        "policy": policy_title(policy),
                        "direction (°)": round(float(np.degrees(direction)), 6),
                        "speed (m/s)": float(speed),
                        "robots": basin.grid.n_phases,
                        "survived": survived,
                        "share": survived / basin.grid.n_phases,
                        "95 % from": low,
                        "95 % to": high,
                    }
                )
    return pd.DataFrame(rows)
