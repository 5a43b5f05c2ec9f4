"""What an intervention does to the robot, and whether that is what the claim says."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from glassgait.models.arrays import Array
from glassgait.studies.common.scores import interval
from glassgait.studies.explanation.interventions.derivation import Claim, spoken_of
from glassgait.studies.explanation.interventions.walks import Walk

FOLLOWED = {
    "cmd.v": "going_speed_error",
    "cmd.yaw": "yaw_rate_error",
    "e.v": "going_speed_error",
}
"""Score that a term of an input is there for: how far the robot is from its command."""


@dataclass(frozen=True)
class Effect:
    """A difference that an intervention makes, paired by robot.

    Attributes:
        measured: Mean over robots.
        margin: Half of its 95 % interval; NaN of fewer than two robots.
        robots: Number of robots that it is of.
    """

    measured: float
    margin: float
    robots: int

    def holds(self, sign: float) -> bool:
        """Returns whether the effect has a sign, and its interval excludes 0."""
        return bool(np.sign(sign) * self.measured > self.margin)


def paired_effect(with_it: Array, without: Array) -> Effect:
    """Compares robots with themselves.

    Args:
        with_it: A number of each robot under the intervention (n,); NaN where there is none.
        without: The same without it (n,).
    """
    difference = pd.Series(with_it - without).dropna()
    mean = float(difference.mean()) if len(difference) else float("nan")
    return Effect(mean, interval(difference), len(difference))


def angle_effect(claim: Claim, plain: Walk, edited: Walk) -> Effect:
    """Measures how far a claim's joint is moved, at the instants that it speaks of (rad)."""
    return paired_effect(_mean_angle(claim, edited), _mean_angle(claim, plain))


def following_effect(score: str, plain: Walk, edited: Walk) -> Effect:
    """Measures by how much more robots miss their commands (m/s or rad/s)."""
    return paired_effect(*(walk.scores[score].to_numpy(dtype=float) for walk in (edited, plain)))


def _mean_angle(claim: Claim, walk: Walk) -> Array:
    """Returns the joint's mean angle of each robot (n,); NaN where the claim speaks of nothing."""
    mask = spoken_of(claim, walk)
    counts = mask.sum(axis=0)
    total = np.where(mask, walk.angle[..., claim.term.joint], 0.0).sum(axis=0)
    return np.where(counts > 0, total / np.maximum(counts, 1), np.nan)
