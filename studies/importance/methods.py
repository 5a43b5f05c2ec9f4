"""Importances of observations for each joint, by several methods."""

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.policies.linear import LinearPolicy, StatewiseLinearPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import FormulaPolicy
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


def own_importance(policy: Policy, observations: Array) -> tuple[str, Array] | None:
    """Returns the importance that a student's own shape gives, if it has one.

    Boosted trees: impurity. Additive: the mean size of each function, one of two observations
    counting half for each. Formulas and linear laws: the mean size of the partial derivative times
    the observation's spread.

    Args:
        policy: The student.
        observations: Observations along rollouts (m, n).

    Returns:
        Name of the method in `METHOD_TITLES` and importances (12, n).
    """
    spread = observations.std(axis=0)
    match policy:
        case BoostedTreesPolicy():
            return "impurity", policy.importances
        case AdditivePolicy():
            return "terms", _additive_importance(policy, observations)
        case FormulaPolicy():
            slopes = np.abs(policy.derivatives(observations)).mean(axis=0)
            return "derivatives", slopes * spread
        case LinearPolicy():
            return "derivatives", np.abs(policy.weights) * spread
        case StatewiseLinearPolicy():
            share = policy.state_shares(observations)
            slopes = np.tensordot(share, np.abs(policy.weights), axes=1)
            return "derivatives", slopes * spread
        case _:
            return None


def _additive_importance(policy: AdditivePolicy, observations: Array) -> Array:
    single, pairs = policy.term_values(observations)
    importances = np.abs(single - single.mean(axis=0)).mean(axis=0)
    sizes = np.abs(pairs - pairs.mean(axis=0)).mean(axis=0)
    for (first, second), joint, size in zip(policy.pairs, policy.pair_joints, sizes, strict=True):
        importances[joint, [first, second]] += 0.5 * size
    return importances
