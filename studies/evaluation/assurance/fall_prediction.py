"""Whether overruns predict falls, and how late the expert can still take over."""

from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from glassgait.diagrams.scenario import Pushes, Scenario
from glassgait.models.policies.controller import Controller
from glassgait.models.task.assurance import Hysteresis, Region
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import entries_of
from glassgait.studies.common.episode import episode
from glassgait.studies.evaluation.assurance.calibration import Visits, guarded

LEADS = (1, 2, 4, 8, 12, 16, 24, 32)
"""Control steps before a fall at which the expert takes over."""

RESCUE_STEPS = 150
"""Control steps that a robot must then stay up."""


def warnings_of(visits: Visits, region: Region, hysteresis: Hysteresis) -> pd.DataFrame:
    """Measures for how long before each fall the expert would have been called.

    Returns:
        A row a fall: `robot`, `step`, `warning` in control steps without a gap up to the fall, and
        `first`, the group of the observation that was farthest outside when that began.
    """
    overruns = region.overruns(visits.observation)
    called = guarded(overruns.max(axis=-1), hysteresis)
    groups = [*(entry.group for entry in entries_of(region.names)), "disagreement"]
    rows = []
    for robot in visits.fallen:
        step = visits.fell[robot]
        quiet = np.flatnonzero(~called[: step + 1, robot])
        begun = int(quiet[-1]) + 1 if len(quiet) else 0
        first = groups[overruns[begun, robot].argmax()] if begun <= step else "none"
        rows.append((int(robot), int(step), int(step) + 1 - begun, first))
    return pd.DataFrame(rows, columns=["robot", "step", "warning", "first"])


def prediction_row(
    nominal: Visits, pushed: Visits, region: Region, hysteresis: Hysteresis
) -> dict[str, Any]:
    """Sums up how a region predicts falls under pushes."""
    found = warnings_of(pushed, region, hysteresis)
    shares = [
        float(guarded(region.overrun(own.observation), hysteresis)[own.alive].mean())
        for own in (nominal, pushed)
    ]
    return {
        "limit": hysteresis.limit,
        "calls_in_distribution": shares[0],
        "calls_under_pushes": shares[1],
        "falls": len(found),
        "predicted": int((found["warning"] > 0).sum()),
        "predicted_8": int((found["warning"] >= 8).sum()),
        "median_warning": float(found["warning"].median()),
    }


def rescues(
    gait: Gait, controller: Controller, scenario: Scenario, visits: Visits, seed: int
) -> pd.DataFrame:
    """Takes every fall back by some steps and lets another controller go on, without more pushes.

    Args:
        gait: The gait.
        controller: The other controller.
        scenario: The world that robots fell in.
        visits: Where robots were until they fell.
        seed: Seed of the noise.

    Returns:
        A row a lead: `lead` in control steps, the `falls` that were so late in the episode, and of
        these the `rescued`, which stay up for `RESCUE_STEPS`.
    """
    assert visits.snapshots is not None
    calm = replace(scenario, pushes=Pushes(speed=0.0))
    rows = []
    for lead in LEADS:
        robots = visits.fallen[visits.fell[visits.fallen] + 1 >= lead]
        n, rescued = len(robots), 0
        if n:
            ended = episode(
                gait,
                controller,
                calm,
                n_robots=n,
                n_steps=RESCUE_STEPS,
                seed=seed,
                start=visits.snapshots.at(robots, visits.fell[robots] + 1 - lead),
            )
            rescued = int(np.sum(ended.fell == RESCUE_STEPS))
        rows.append({"lead": lead, "falls": n, "rescued": rescued})
    return pd.DataFrame(rows)
