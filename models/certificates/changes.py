"""What two observations show: how much an action can change, and left against right."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.certificates.formula_targets import FormulaTargets
from glassgait.models.certificates.maximum import Box
from glassgait.models.certificates.observation_box import ObservationBox
from glassgait.models.certificates.question import Targets
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task.symmetry import REFLECT_JOINTS, reflect_observation

PAIRS = 512
SWEEPS = 3
"""A wide change is sought among random pairs at the ends, then quantity by quantity."""


def largest_change(
    robot: Robot,
    targets: Targets,
    state: int,
    joints: NDArray[np.intp],
    changes: Array,
    region: Box,
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
    region: Box,
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


def _pairs(one: Array, other: Array, index: int, change: float, region: Box) -> tuple[Array, Array]:
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


SAMPLES = 1000


def mirrored_exactly(targets: Targets, images: Sequence[int], names: tuple[str, ...]) -> bool:
    """Returns whether formulas, multiplied out, are mirror images of one another.

    Args:
        targets: The policy's targets; of other kinds than formulas it is False.
        images: State that each state of the machine is in the mirror.
        names: Names of the observations.
    """
    if not isinstance(targets, FormulaTargets):
        return False
    reflection = reflect_observation(names, images)
    return all(
        targets.polynomial(state, joint)
        == targets.image(image, int(REFLECT_JOINTS.index[joint]), reflection)
        for state, image in enumerate(images)
        for joint in range(quadruped.N_JOINTS)
    )


def asymmetry(
    policy: Policy, images: Sequence[int], box: ObservationBox
) -> tuple[float, int, Array]:
    """Finds where a policy differs most from its mirror image, among random observations.

    Returns:
        The difference of the target (rad), the joint, and the observation in the robot's units (n).
    """
    observations = box.random(SAMPLES, np.random.default_rng(0))
    reflection = reflect_observation(policy.observation_names, images)
    image = REFLECT_JOINTS(policy(reflection(observations)))
    difference = policy.robot.action_scale * np.abs(policy(observations) - image)
    row, joint = np.unravel_index(int(np.argmax(difference)), difference.shape)
    quantities = RobotUnits.of(box.robot, box.names).quantities(observations[row])
    return float(difference[row, joint]), int(joint), quantities
