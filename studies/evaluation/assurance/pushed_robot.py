"""One robot that is pushed, in the diagram: with the student alone, and under assurance."""

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.plant_state import push
from glassgait.diagrams.rollout import Rollout, make_simulator, record
from glassgait.diagrams.scenario import Scenario
from glassgait.models.arrays import Array
from glassgait.models.files import record_or_made
from glassgait.models.policies.controller import AssuredController, Controller
from glassgait.models.robots import quadruped
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait
from glassgait.studies.evaluation.assurance.study import Calibration, Pair

SPEED = 0.5
"""Commanded speed (m/s)."""

SECONDS = 4.0
"""Length of a rollout (s)."""

PUSH = 1.0
"""What a push adds along each horizontal axis (m/s), with either sign."""

INSTANTS = tuple(range(60, 76, 3))
"""Control steps at which it is tried, over a cycle of the gait."""


def push_one(pair: Pair, calibration: Calibration, path: Path, *, of: str) -> dict[str, Any]:
    """Pushes one robot until the student alone falls, and then once more under assurance.

    Directions are diagonals, as strong as the world of pushes has them. Where the student never
    falls, the push that ends the highest overrun is shown.

    Args:
        pair: An expert and its student.
        calibration: The region and the limits, of which those of most calls are taken.
        path: Where the outcome is kept; it is read if it is there.
        of: What identifies the run.

    Returns:
        `push`, the control step of the push and its velocity (m/s), and of `alone` and `assured`
        the trunk's `height` (m), the `overrun` and `expert_acts`, a value a control instant, and
        whether it `fell`.
    """
    return record_or_made(path, lambda: _push_one(pair, calibration), of=of)


def _push_one(pair: Pair, calibration: Calibration) -> dict[str, Any]:
    alone = pair.alone[pair.name]
    hysteresis = calibration.hysteresis[max(calibration.hysteresis)]
    assured = AssuredController(pair.expert, pair.student, calibration.region, hysteresis)
    tried = []
    for step, x, y in product(INSTANTS, (-PUSH, PUSH), (-PUSH, PUSH)):
        velocity = np.array([x, y, 0.0])
        rollout = _pushed(pair.gait, alone, step, velocity)
        worst = float(calibration.region.overrun(rollout["observations"]).max())
        tried.append((rollout.failed, worst, step, velocity, rollout))
        if rollout.failed:
            break
    _, _, step, velocity, rollout = max(tried, key=lambda one: one[:2])
    guarded = _pushed(pair.gait, assured, step, velocity)
    return {
        "push": [step, velocity.tolist()],
        "alone": _outcome(rollout, calibration),
        "assured": _outcome(guarded, calibration),
    }


def _pushed(gait: Gait, policy: Controller, step: int, velocity: Array) -> Rollout:
    diagram = MakeLocomotion(gait, Scenario(command=FixedCommand(speed=SPEED)), policy=policy)
    simulator = make_simulator(diagram)

    def pushed() -> bool:
        # Between two control steps, as pushes come in the batch simulator.
        if round(simulator.get_context().get_time() / CONTROL_PERIOD) == step:
            push(diagram, simulator.get_mutable_context(), velocity)
        return False

    return record(simulator, round(SECONDS / CONTROL_PERIOD), stopped=pushed)


def _outcome(rollout: Rollout, calibration: Calibration) -> dict[str, Any]:
    overrun = calibration.region.overrun(rollout["observations"])
    acts = rollout.values.get("expert_acts", np.zeros((len(overrun), 1)))
    return {
        "height": rollout["state"][:, quadruped.POSITION][:, 2].tolist(),
        "overrun": np.minimum(overrun, 100.0).tolist(),
        "expert_acts": acts[:, 0].tolist(),
        "fell": rollout.failed,
    }
