"""How alike a policy treats left and right: of its actions, and of what it looks at."""

from dataclasses import replace
from itertools import product

import numpy as np
import pandas as pd
from sklearn.metrics import r2_score

from glassgait.models.arrays import Array
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.models.task.observation import entries_of
from glassgait.models.task.symmetry import REFLECT_JOINTS, Reflection
from glassgait.studies.distillation.students.dataset import Dataset
from glassgait.studies.importance.methods import permutation_importance

LEFT_LEGS = ("FL", "RL")

SIDES = ("own", "other")
"""Where the legs are that are observed, seen from the joint that acts."""

NORMAL_QUANTILE = 1.96
"""Standard errors that half of a 95 % interval takes."""


def mirror_r2(
    policy: Policy,
    samples: Dataset,
    reflect: Reflection,
    generator: np.random.Generator,
    resamples: int,
) -> tuple[float, float, float]:
    """Measures how well a policy's actions are foretold by its actions in the mirror.

    Args:
        policy: The policy π.
        samples: Observations o that robots visited, each robot an episode; labels do not count.
        reflect: The mirror M of observations.
        generator: Source of randomness.
        resamples: Draws of as many robots, with replacement, that the interval is of.

    Returns:
        R² of M π(M o) against π(o), mean over the joints, and the ends of its 95 % interval.
    """
    own = policy(samples.observations)
    image = REFLECT_JOINTS(policy(reflect(samples.observations)))
    robots, robot_of_sample = np.unique(samples.episodes, return_inverse=True)

    def mean_r2(draws: Array) -> float:
        """Takes how often each robot was drawn (n_robots,)."""
        return float(r2_score(own, image, sample_weight=draws[robot_of_sample]))

    equal = np.full(len(robots), 1.0 / len(robots))
    drawn = generator.multinomial(len(robots), equal, size=resamples).astype(float)
    low, high = np.quantile([mean_r2(draws) for draws in drawn], (0.025, 0.975))
    return mean_r2(np.ones(len(robots))), float(low), float(high)


def drawn_importances(
    policy: Policy,
    samples: Dataset,
    generator: np.random.Generator,
    *,
    n_samples: int,
    repeats: int,
) -> Array:
    """Measures permutation importances for the policy's own actions, on robots drawn anew.

    How much they differ shows what chance does: which robots and instants were met, and how values
    were shuffled.

    Args:
        policy: The policy.
        samples: Observations that robots visited, each robot an episode; labels do not count.
        generator: Source of randomness.
        n_samples: Samples of a repeat.
        repeats: Draws of robots, with replacement, and of samples of theirs.

    Returns:
        Losses of R² (repeats, 12, n).
    """
    robots = np.unique(samples.episodes)
    own = replace(samples, actions=policy(samples.observations))
    losses = []
    for _ in range(repeats):
        drawn = generator.choice(robots, size=len(robots))
        theirs = np.concatenate([np.flatnonzero(own.episodes == one) for one in drawn])
        rows = generator.choice(theirs, size=n_samples)
        part = Dataset(own.observations[rows], own.actions[rows], own.episodes[rows])
        losses.append(permutation_importance(policy, part, generator, repeats=1)[0])
    return np.array(losses)


def left_right_table(
    importances: Array, names: tuple[str, ...], reflect: Reflection
) -> pd.DataFrame:
    """Sets the importance of the left legs' observations beside that of the right legs'.

    An observation i of a left leg for a joint j is paired with its image M(i) for the image M(j).

    Args:
        importances: What `drawn_importances` returned (repeats, 12, n).
        names: Names of the observations.
        reflect: The mirror of observations.

    Returns:
        A row for each joint type, kind of observation that legs have, and `side`, the legs being on
        the joints' `own` side or on the `other`: `left` and `right`, added up over the observations
        of two legs and averaged over two joints, with half their 95 % intervals, `left_ci` and
        `right_ci`; `left_share`, the left's share of both, NaN where both are 0; and `agree`,
        whether the intervals overlap.
    """
    images = importances[:, REFLECT_JOINTS.index][:, :, reflect.index]
    entries = entries_of(names)
    kinds = dict.fromkeys(entry.merged_name for entry in entries if entry.leg is not None)
    rows = []
    for joint, kind, side in product(quadruped.LEG_JOINTS, kinds, SIDES):
        joints = [
            name.endswith(joint) and (name[:2] in LEFT_LEGS) == (side == "own")
            for name in quadruped.JOINTS
        ]
        columns = [entry.merged_name == kind and entry.leg in LEFT_LEGS for entry in entries]
        left, right = (
            values[:, joints][:, :, columns].sum(axis=2).mean(axis=1)
            for values in (importances, images)
        )
        place = {"joint": joint, "observation": kind, "side": side}
        rows.append({**place, **_compared(left, right)})
    return pd.DataFrame(rows)


def _compared(left: Array, right: Array) -> dict[str, float | bool]:
    """Compares importances (repeats,) of both sides."""
    means = float(left.mean()), float(right.mean())
    halves = [NORMAL_QUANTILE * float(side.std(ddof=1)) for side in (left, right)]
    whole = sum(means)
    return {
        "left": means[0],
        "left_ci": halves[0],
        "right": means[1],
        "right_ci": halves[1],
        "left_share": means[0] / whole if whole > 0 else float("nan"),
        "agree": abs(means[0] - means[1]) <= sum(halves),
    }
