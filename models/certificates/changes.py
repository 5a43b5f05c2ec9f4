"""How much an action can change where observations change by bounded amounts."""

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.certificates.maximum import Region
from glassgait.models.certificates.observation_box import ObservationBox
from glassgait.models.certificates.question import Targets
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.policies.policy import Policy
from glassgait.models.robots.robot import Robot

PAIRS = 512
SWEEPS = 3
"""A wide change is sought among random pairs at the ends, then quantity by quantity."""


def largest_change(
    robot: Robot,
    targets: Targets,
    state: int,
    joints: NDArray[np.intp],
    changes: Array,
    region: Region,
) -> float:
    """Bounds the squared change of the action.

    Both observations are in the box. Each joint is bounded by itself, as the sum of what each
    observation can do.

    Args:
        robot: The robot.
        targets: The policy's targets.
        state: State of the machine, which is held.
        joints: The joints whose actions count.
        changes: How much each quantity may change (n).
        region: The box.
    """
    whole = 0.0
    for joint in joints.tolist():
        used = sorted(targets.used(state, joint) & set(np.flatnonzero(changes).tolist()))
        most = sum(targets.change(state, joint, i, float(changes[i]), region) for i in used)
        most += 2.0 * targets.rounding(state, joint, region)
        whole += (most / robot.action_scale) ** 2
    return whole


def widest_change(
    policy: Policy,
    joints: NDArray[np.intp],
    changes: Array,
    box: ObservationBox,
    region: Region,
) -> tuple[float, Array, Array]:
    """Seeks two observations of a box between which the action changes most.

    Returns:
        The squared change of the action, and both observations in the robot's units (n, n).
    """
    generator, units = np.random.default_rng(0), RobotUnits.of(box.robot, box.names)
    counted = np.isin(np.arange(len(changes)), list(region.counted))
    # A hair less, so that two witnesses are not a rounding further apart than is claimed.
    changes = np.where(counted, np.floor(changes), (1.0 - 1e-12) * changes)
    first = units.quantities(box.random(PAIRS, generator))
    first = np.clip(first, region.lower, region.upper)
    signs = generator.choice([-1.0, 1.0], first.shape)
    second = np.clip(first + signs * changes, region.lower, region.upper)

    def squared(one: Array, other: Array) -> Array:
        moved = [policy((own - units.offset) * units.scale)[..., joints] for own in (one, other)]
        return np.sum(np.square(moved[1] - moved[0]), axis=-1)

    values = squared(first, second)
    best = int(np.argmax(values))
    one, other, value = first[best], second[best], float(values[best])
    for _ in range(SWEEPS):
        for index in range(len(changes)):
            pairs = _pairs(one, other, index, changes[index], region)
            values = squared(*pairs)
            if values.max() > value:
                best = int(np.argmax(values))
                one, other, value = pairs[0][best], pairs[1][best], float(values[best])
    return value, one, other


def _pairs(
    one: Array, other: Array, index: int, change: float, region: Region
) -> tuple[Array, Array]:
    """Returns pairs that differ from one in one quantity."""
    low, high = region.lower[index], region.upper[index]
    values = np.array([low, high, 0.5 * (low + high), one[index]])
    if index in region.counted:
        values = np.floor(values)
    ends = [np.clip(values + shift, low, high) for shift in (-change, 0.0, change)]
    starts = np.tile(one, (3 * len(values), 1))
    starts[:, index] = np.tile(values, 3)
    goals = np.tile(other, (3 * len(values), 1))
    goals[:, index] = np.concatenate(ends)
    return starts, goals
