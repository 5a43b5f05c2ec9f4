"""Importances of observations for each joint, by several methods."""

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.policies.policy import Policy
from glassgait.models.task.observation import indices_of
from glassgait.studies.distillation.students.dataset import Dataset, r2_scores

METHOD_TITLES = {
    "permutation": "permutation importance",
    "impurity": "impurity importance",
    "terms": "mean size of terms",
    "derivatives": "mean slope × spread",
}


def permutation_importance(
    policy: Policy, samples: Dataset, generator: np.random.Generator, repeats: int = 10
) -> Array:
    """Measures how much R² each joint loses when one observation is shuffled.

    The entries of the machine's state are shuffled together, so that each sample keeps exactly one
    state. What is lost without them is divided equally among them.

    Args:
        policy: The student.
        samples: Held-out samples with the expert's actions.
        generator: Source of randomness.
        repeats: Shuffles of each observation.

    Returns:
        Losses of R² (repeats, 12, n).
    """
    whole = r2_scores(policy, samples)
    observations = samples.observations
    state = set(indices_of("machine state", policy.observation_names))
    blocks = [[column] for column in range(observations.shape[1]) if column not in state]
    blocks += [sorted(state)] if state else []
    losses = np.zeros((repeats, len(whole), observations.shape[1]))
    for repeat in range(repeats):
        for columns in blocks:
            shuffled = observations.copy()
            shuffled[:, columns] = generator.permutation(observations[:, columns])
            scores = r2_scores(policy, Dataset(shuffled, samples.actions, samples.episodes))
            losses[repeat, :, columns] = (whole - scores) / len(columns)
    return losses
