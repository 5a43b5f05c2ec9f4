"""Whether a policy treats left and right alike: exactly, or with an observation where not."""

from collections.abc import Sequence

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.certificates.formula_targets import FormulaTargets
from glassgait.models.certificates.observation_box import ObservationBox
from glassgait.models.certificates.question import Targets
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.models.task.symmetry import REFLECT_JOINTS, reflect_observation

SAMPLES = 1000


def mirrored_exactly(targets: Targets, images: Sequence[int], names: tuple[str, ...]) -> bool:
    """Tells whether formulas, multiplied out, are mirror images of one another.

    Args:
        targets: The policy's targets; of other kinds than formulas nothing is told.
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
