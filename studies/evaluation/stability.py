"""Tables of the stride map: orbits and modes, and predicted against simulated decay."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
import pandas as pd
from annotated_types import Gt, Le, MinLen

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.scenario import TRAINING
from glassgait.models.settings import DISTINCT, FEW, Count
from glassgait.models.task.command import Command
from glassgait.models.task.gait import Gait
from glassgait.studies.common.cases import Case
from glassgait.studies.common.experiment import Experiment, Report
from glassgait.studies.distillation.students.registry import policy_title
from glassgait.studies.evaluation.stability_figures import believed, radius_error, stability_figure
from glassgait.studies.evaluation.stride_analysis import PUSHES, analyse
from glassgait.studies.evaluation.strides import StrideMap

SHARE_NAMED = 0.1
"""Parts that are named of a slowest mode have this share of it at least."""

N_NAMED = 3
"""How many of them are named at most."""


def orbit_text(record: Mapping[str, Any]) -> str:
    """Describes where a gait goes."""
    period = record["period"]
    match period:
        case -1:
            return "falls, or leaves the gait"
        case 0:
            return f"wanders ({record['sway']:.2g})"
        case 1:
            return "periodic"
        case _:
            return f"repeats every {period} strides"


def mode_text(parts: Mapping[str, float]) -> str:
    """Names what takes part most in a mode."""
    most = [(name, share) for name, share in parts.items() if share >= SHARE_NAMED]
    return ", ".join(f"{name} {100 * share:.0f} %" for name, share in most[:N_NAMED]) or "–"


def stability_table(results: Mapping[str, Sequence[Mapping[str, Any]]]) -> pd.DataFrame:
    """Makes a row of each policy and command."""
    rows = []
    for policy, records in results.items():
        for record in records:
            there = "radius" in record
            rows.append(
                {
                    "policy": policy_title(policy),
                    "speed (m/s)": record["speed"],
                    "yaw rate (rad/s)": record["yaw_rate"],
                    "dwell": record["dwell"],
                    "without noise the gait": orbit_text(record),
                    "spectral radius": record["radius"] if there else float("nan"),
                    "±, step sizes": radius_error(record),
                    "slowest mode": mode_text(record["parts"]) if there else "–",
                    "growth along the orbit": record.get("growth", float("nan")),
                    "averaged radius": record.get("averaged_radius", float("nan")),
                    "±, jackknife": record.get("averaged_error", float("nan")),
                    "strides of another length": (
                        f"{record['other_steps']} of {record['rows']}" if there else "–"
                    ),
                }
            )
    return pd.DataFrame(rows)


def prediction_table(results: Mapping[str, Sequence[Mapping[str, Any]]]) -> pd.DataFrame:
    """Sets the slowest mode's factor per stride against that of simulated pushes."""
    rows = []
    for policy, records in results.items():
        for record in records:
            if "decays" not in record:
                continue
            row = {
                "policy": policy_title(policy),
                "speed (m/s)": record["speed"],
                "yaw rate (rad/s)": record["yaw_rate"],
                "dwell": record["dwell"],
                "predicted": record["radius"],
            }
            for push, factor in zip(PUSHES, record["decays"], strict=True):
                row[f"push of {push:g} m/s"] = factor
            worst = np.abs(np.array(record["decays"]) / record["radius"] - 1.0)
            row["within 10 % up to (m/s)"] = _reach(worst)
            rows.append(row)
    return pd.DataFrame(rows)


def summary_table(results: Mapping[str, Sequence[Mapping[str, Any]]]) -> pd.DataFrame:
    """Sums up every policy over its commands."""
    rows = []
    for policy, records in results.items():
        radii = np.array([record["radius"] for record in records if believed(record)])
        averaged = np.array([record.get("averaged_radius", np.nan) for record in records])
        shares: dict[str, float] = {}
        for record in records:
            for name, share in record.get("parts", {}).items() if believed(record) else ():
                shares[name] = shares.get(name, 0.0) + share / len(radii)
        shares = dict(sorted(shares.items(), key=lambda part: -part[1]))
        rows.append(
            {
                "policy": policy_title(policy),
                "periodic": f"{sum(r['period'] == 1 for r in records)} of {len(records)}",
                "fixed points": f"{len(radii)} of {len(records)}",
                "that attract": f"{int((radii < 1.0).sum())} of {len(radii)}",
                "spectral radius, least": radii.min(initial=np.inf) if len(radii) else np.nan,
                "median": float(np.median(radii)) if len(radii) else np.nan,
                "greatest": radii.max(initial=0.0) if len(radii) else np.nan,
                "averaged radius, mean": _mean(averaged),
                "slowest mode": mode_text(shares),
            }
        )
    return pd.DataFrame(rows)


def _reach(misses: np.ndarray) -> str:
    """Names the greatest push up to which the prediction holds."""
    fails = np.flatnonzero(~(misses <= 0.1))
    reach = fails[0] if len(fails) else len(misses)
    return f"{PUSHES[reach - 1]:g}" if reach else "none"


def _mean(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")


SLOWEST, FASTEST = 0.25, 0.75
"""Least and greatest speed by default (m/s), at most the gait's."""

StepSize = Annotated[float, Gt(0.0), Le(1.0)]


@dataclass(frozen=True)
class Stability(Experiment):
    """Find whether small differences grow or fade from one stride to the next, and test it.

    Attributes:
        speeds: Commanded forward speeds (m/s); by default three from 0.25 to 0.75, at most
            the gait's.
        yaw_rates: Commanded yaw rates (rad/s).
        dwell: Commanded dwell of every speed and yaw rate (control steps).
        dwells: Further dwells at the middle speed and yaw rate; every one of the gait by default.
        n_strides: Strides that a gait has to settle, from standing.
        step_sizes: Sizes of the differences that the map is differentiated by, in units of what a
            gait sways (0.01 m, 0.05 rad, 0.1 m/s, …); their spread shows the error.
    """

    title: ClassVar[str] = "evaluate stability"
    scenario: ClassVar[tuple[str, ...]] = (TRAINING,)
    n_robots: ClassVar[int] = 1
    n_seeds: ClassVar[int] = 1

    speeds: Annotated[tuple[float, ...], FEW, DISTINCT] = ()
    yaw_rates: Annotated[tuple[float, ...], MinLen(1), FEW, DISTINCT] = (-0.5, 0.0, 0.5)
    dwell: Count = 8
    dwells: Annotated[tuple[int, ...], FEW, DISTINCT] = ()
    n_strides: Count = 60
    step_sizes: Annotated[tuple[StepSize, ...], MinLen(2), FEW, DISTINCT] = (1e-3, 3e-3, 1e-2)

    def measure(self, case: Case) -> pd.DataFrame:
        """Analyses the stride map of one policy: a row a command."""
        stride_map = StrideMap(case.gait, case.alone, self._commands(case.gait))
        records = analyse(
            stride_map, n_strides=self.n_strides, step_sizes=self.step_sizes, seed=case.seed
        )
        return pd.DataFrame({"record": records})

    def report(self, table: pd.DataFrame) -> Report:
        """Reports orbits, modes, and predicted against simulated decay."""
        results = {
            str(policy): own["record"].tolist()
            for policy, own in table.groupby("policy", sort=False)
        }
        gait = str(table["gait"].iloc[0])
        summed = summary_table(results)
        return Report(
            tables={
                "summary": summed,
                "stability": stability_table(results),
                "prediction": prediction_table(results),
            },
            metrics=_without_nan(results),
            figures={"stability": stability_figure(results, gait.capitalize())},
            shown={f"{gait}: the stride map": summed},
        )

    def _commands(self, gait: Gait) -> Command:
        """Lists the commands: every speed with every yaw rate, then the further dwells.

        Raises:
            InputError: if the gait is not made for one.
        """
        fastest = min(FASTEST, gait.max_speed)
        speeds = self.speeds or tuple(np.linspace(SLOWEST, fastest, 3).tolist())
        dwells = self.dwells or tuple(range(gait.dwell[0], gait.dwell[1] + 1))
        grid = [(speed, rate, self.dwell) for speed in speeds for rate in self.yaw_rates]
        middle = speeds[len(speeds) // 2], self.yaw_rates[len(self.yaw_rates) // 2]
        grid += [(*middle, dwell) for dwell in dwells if dwell != self.dwell]
        for speed, yaw_rate, dwell in grid:
            FixedCommand(speed, yaw_rate, dwell).check(gait)
        values = np.array(grid, dtype=float)
        return Command(values[:, :2], values[:, 2])


def _without_nan(values: Any) -> Any:
    """Puts null where JSON has no NaN."""
    if isinstance(values, Mapping):
        return {name: _without_nan(value) for name, value in values.items()}
    if isinstance(values, list):
        return [_without_nan(value) for value in values]
    return None if isinstance(values, float) and not np.isfinite(values) else values
