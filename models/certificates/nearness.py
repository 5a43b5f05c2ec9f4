"""A witness beside what a robot observed: how far apart they are, and at which moment least."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.certificates.certificate import claimed_joint
from glassgait.models.certificates.claims import Claim
from glassgait.models.certificates.observation_box import ObservationBox
from glassgait.models.certificates.prover import Observed, Verdict
from glassgait.models.certificates.question import Targets
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.robots.robot import Robot
from glassgait.models.task.observation import (
    entries_of,
    indices_of,
    machine_state_entries,
    symbols_of,
)

TOLERANCE = 1e-9
"""Widths by which an observation may pass a box's end: both are computed in double precision."""


@dataclass(frozen=True)
class Nearness:
    """Where a refuted claim's witness lies, as seen from the moments of a rollout.

    Attributes:
        witnesses: The observations that refute it (1 or 2, n), scaled.
        state: The machine's state, by index.
        inputs: The observations that the claim is decided by, by index (k): others, whatever they
            are, change nothing of it.
        widths: Widths of the claim's box (n), in scaled units.
        distances: Distance of each moment from the nearest of the witnesses over these inputs, each
            in widths of its range (n_steps); infinite where the machine is in another state.
    """

    witnesses: Array
    state: int
    inputs: NDArray[np.int64]
    widths: Array
    distances: Array

    @property
    def nearest(self) -> int | None:
        """The moment that is nearest; None where the machine is never in the state."""
        if not np.isfinite(self.distances).any():
            return None
        return int(np.argmin(self.distances))

    @property
    def diagonal(self) -> float:
        """The greatest distance that two observations of the box can have."""
        return float(np.sqrt(len(self.inputs)))


def nearness(
    verdict: Verdict, boxes: Mapping[str, ObservationBox], targets: Targets, observations: Array
) -> Nearness:
    """Compares the witnesses of a refuted claim with the moments of a rollout.

    Args:
        verdict: The claim, with its witnesses.
        boxes: The boxes that it was decided over, by name.
        targets: The policy's targets, which list what they depend on.
        observations: What the robot observed (n_steps, n), scaled.
    """
    robot, names = boxes["operating"].robot, boxes["operating"].names
    witnesses = np.array([observation_of(robot, own, names) for own in verdict.witnesses])
    one_hot = machine_state_entries(names)
    state = int(np.argmax(witnesses[0, one_hot]))
    box = box_of(verdict.claim, boxes).in_state(state)
    widths = box.upper - box.lower
    decided_by = sorted(_inputs(verdict, targets, state, names))
    inputs = np.array([index for index in decided_by if widths[index] > 0.0], dtype=np.int64)
    apart = (observations[:, None, inputs] - witnesses[:, inputs]) / widths[inputs]
    distances = np.linalg.norm(apart, axis=-1).min(axis=-1)
    elsewhere = np.argmax(observations[:, one_hot], axis=-1) != state
    return Nearness(witnesses, state, inputs, widths, np.where(elsewhere, np.inf, distances))


def box_of(claim: Claim, boxes: Mapping[str, ObservationBox]) -> ObservationBox:
    """Returns the box that a claim is about."""
    box = boxes[claim.box]
    symbols = symbols_of(box.names)
    return box.taking([box.names[symbols.index(own)] for own in claim.stuck], boxes["physical"])


def overruns(box: ObservationBox, observations: Array) -> Array:
    """Measures by how much observations (n_steps, n) are outside of a box.

    Returns:
        Overruns (n_steps, n) in widths of the ranges; 0 inside.
    """
    held = [box.in_state(state) for state in range(box.n_states)]
    state = np.argmax(observations[..., machine_state_entries(box.names)], axis=-1)
    lower, upper = np.array([(one.lower, one.upper) for one in held]).swapaxes(0, 1)[:, state]
    excess = np.maximum(lower - observations, observations - upper)
    with np.errstate(divide="ignore", invalid="ignore"):
        widths = np.where(excess <= 0.0, 0.0, excess / (upper - lower))
    found = np.where(np.isfinite(excess), widths, np.inf)
    return np.where(found > TOLERANCE, found, 0.0)


def observation_of(robot: Robot, witness: Observed, names: tuple[str, ...]) -> Array:
    """Returns a witness, whose quantities are in the robot's units, as it is observed (n)."""
    quantities = np.array([witness[entry.symbol] for entry in entries_of(names)])
    return RobotUnits.of(robot, names).observed(quantities)


def _inputs(
    verdict: Verdict, targets: Targets, state: int, names: tuple[str, ...]
) -> frozenset[int]:
    """Returns the observations that a claim is decided by where its witness is."""
    joint, claim = claimed_joint(verdict), verdict.claim
    if joint is None or claim.kind == "mirror":
        # A mirror image is of another joint, and perhaps of another state.
        return frozenset(range(len(names)))
    used = targets.used(state, joint)
    if claim.kind == "torque":
        return used | {indices_of("joint position", names)[joint]}
    return used
