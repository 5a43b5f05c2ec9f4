"""Whether overruns foretell falls, and how late the expert can still take over."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from glassgait.diagrams.scenario import Pushes, Scenario
from glassgait.diagrams.task_state import TaskState
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.task.assurance import Hysteresis, Region
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import entries_of
from glassgait.studies.common.rollouts.roll_out import make_batch
from glassgait.studies.evaluation.assurance.calibration import guarded
from glassgait.studies.evaluation.assurance.visits import Visits

LEADS = (1, 2, 4, 8, 12, 16, 24, 32)
"""Control steps before a fall at which the expert takes over."""

RESCUE_STEPS = 150
"""Control steps that a robot must then stay up."""


def warnings_of(visits: Visits, region: Region, hysteresis: Hysteresis) -> pd.DataFrame:
    """Tells of every fall for how long the expert would have been called before.

    Returns:
        A row a fall: `robot`, `step`, `warning` in control steps without a gap up to the fall, and
        `first`, the group of the observation that was farthest outside when that began.
    """
    overruns = region.overruns(visits.observation)
    called = guarded(overruns.max(axis=-1), hysteresis)
    groups = [*(entry.group for entry in entries_of(region.names)), "bags"]
    rows = []
    for robot in visits.fallen:
        step = visits.fell[robot]
        quiet = np.flatnonzero(~called[: step + 1, robot])
        begun = int(quiet[-1]) + 1 if len(quiet) else 0
        first = groups[overruns[begun, robot].argmax()] if begun <= step else "none"
        rows.append((int(robot), int(step), int(step) + 1 - begun, first))
    return pd.DataFrame(rows, columns=["robot", "step", "warning", "first"])


def foretelling_row(
    home: Visits, pushed: Visits, region: Region, hysteresis: Hysteresis
) -> dict[str, Any]:
    """Sums up how a region tells falls under pushes from walking."""
    found = warnings_of(pushed, region, hysteresis)
    shares = [
        float(guarded(region.overrun(own.observation), hysteresis)[own.alive].mean())
        for own in (home, pushed)
    ]
    return {
        "limit": hysteresis.limit,
        "calls_at_home": shares[0],
        "calls_under_pushes": shares[1],
        "falls": len(found),
        "foretold": int((found["warning"] > 0).sum()),
        "foretold_8": int((found["warning"] >= 8).sum()),
        "median_warning": float(found["warning"].median()),
    }


def rescues(
    gait: Gait, policy: AlternatingController, scenario: Scenario, visits: Visits, seed: int
) -> pd.DataFrame:
    """Takes every fall back by some steps and lets another policy go on, without more pushes.

    Args:
        gait: The gait.
        policy: Who goes on.
        scenario: The world that they fell in.
        visits: Where robots were until they fell.
        seed: Seed of the noise.

    Returns:
        A row a lead: `lead` in control steps, the `falls` that were so late in the episode, and of
        these the `rescued`, which stay up for `RESCUE_STEPS`.
    """
    calm = replace(scenario, pushes=Pushes(speed=0.0))
    rows = []
    for lead in LEADS:
        robots = visits.fallen[visits.fell[visits.fallen] + 1 >= lead]
        begun = visits.fell[robots] + 1 - lead
        up = np.ones(len(robots), dtype=bool)
        if len(robots):
            simulator = make_batch(gait, policy, calm, n_robots=len(robots), seed=seed)
            simulator.restore(_gathered(visits, robots, begun))
            memory = policy.begin(len(robots))
            for step in range(RESCUE_STEPS):
                output = policy.advance(step, simulator.observe(), memory)
                memory = output.memory
                action = np.where(up[:, None], output.action, 0.0)
                up &= ~simulator.step(action).failures.any(axis=-1)
        rows.append({"lead": lead, "falls": len(robots), "rescued": int(up.sum())})
    return pd.DataFrame(rows)


def _gathered(visits: Visits, robots: NDArray[np.int64], steps: NDArray[np.int64]) -> TaskState:
    """Returns the states of robots, each at a step of its own."""
    own: list[Mapping[str, Any]] = [visits.states[step].as_arrays() for step in steps]
    arrays = {
        name: np.stack([arrays[name][robot] for arrays, robot in zip(own, robots, strict=True)])
        for name in own[0]
    }
    return TaskState.from_arrays(arrays)
