"""Tables of the stride map: orbits and modes, and predicted against simulated decay."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from glassgait.studies.distillation.students.registry import policy_title
from glassgait.studies.evaluation.stride_analysis import PUSHES

SHARE_NAMED = 0.1
"""Parts that are named of a slowest mode have this share of it at least."""

N_NAMED = 3
"""How many of them are named at most."""

AGREED = 0.02
"""How far radii of the step sizes may lie apart (share) for a derivative to be believed."""


def radius_error(record: Mapping[str, Any]) -> float:
    """Returns half the spread of the spectral radius over the step sizes."""
    radii = np.array(record.get("radii", [np.nan]))
    return float(0.5 * (radii.max() - radii.min()))


def believed(record: Mapping[str, Any]) -> bool:
    """Returns whether a fixed point was found and its spectral radius agrees over step sizes."""
    radius = record.get("radius", float("nan"))
    return bool(2.0 * radius_error(record) <= AGREED * radius)


def told_orbit(record: Mapping[str, Any]) -> str:
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


def told_mode(parts: Mapping[str, float]) -> str:
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
                    "without noise the gait": told_orbit(record),
                    "spectral radius": record["radius"] if there else float("nan"),
                    "±, step sizes": radius_error(record),
                    "slowest mode": told_mode(record["parts"]) if there else "–",
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
                "slowest mode": told_mode(shares),
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
