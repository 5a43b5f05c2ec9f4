"""What two policies ask of the joints at the same observations."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from glassgait.diagrams.rollout import Rollout
from glassgait.models.arrays import Array
from glassgait.models.policies.policy import Policy, first_not_finite
from glassgait.models.robots import quadruped
from glassgait.studies.common.console import say

ALL_JOINTS = "all"
"""Name of the row of `joint_table` that is of all joints together."""

TITLES = {
    "joint": "joint",
    "rms": "root mean square (rad)",
    "largest": "largest (rad)",
    "time": "at (s)",
}
"""What people call the columns of `joint_table`."""


@dataclass(frozen=True)
class TargetDifference:
    """The targets of B less those of A, at every observation of a rollout where A acted.

    Attributes:
        time: The control instants (n; s).
        values: The differences (n, 12; rad); NaN where a target is not finite.
    """

    time: Array
    values: Array


def target_difference(rollout: Rollout, a: Policy, b: Policy) -> TargetDifference:
    """Asks both policies for targets where one of them has been.

    Args:
        rollout: What A did.
        a: The policy that acted.
        b: The other one.
    """
    observations = rollout["observations"]
    targets_a, targets_b = (policy.robot.joint_targets(policy(observations)) for policy in (a, b))
    values = targets_b - targets_a
    if lost := first_not_finite(values):
        step, joint = lost
        say(
            f"a target of {quadruped.JOINTS[joint]} is not finite at control step {step}; what is "
            "not finite is left out of the differences"
        )
        values = np.where(np.isfinite(values), values, np.nan)
    return TargetDifference(rollout.time, values)


def joint_table(difference: TargetDifference) -> pd.DataFrame:
    """Sums up the differences of every joint.

    Returns:
        A row a joint, and a last one of `ALL_JOINTS`: `rms`, the root mean square (rad); `largest`,
        the greatest absolute one (rad), and its `time` (s). NaN where no difference is finite.
    """
    rows = [
        _row(joint, difference.time, difference.values[:, [index]])
        for index, joint in enumerate(quadruped.JOINTS)
    ]
    return pd.DataFrame([*rows, _row(ALL_JOINTS, difference.time, difference.values)])


def told_differences(table: pd.DataFrame) -> str:
    """Tells in a sentence how much the targets differ, and where most."""
    joints, whole = table.iloc[:-1], table.iloc[-1]
    if not np.isfinite(whole["rms"]):
        return "no difference of targets is finite"
    most = joints.iloc[int(np.nanargmax(joints["largest"]))]
    return (
        f"at the same observations targets differ by {whole['rms']:.3g} rad (root mean square), "
        f"most by {most['largest']:.3g} rad, of {most['joint']} at {most['time']:.2f} s"
    )


def _row(joint: str, time: Array, values: Array) -> dict[str, float | str]:
    if np.isnan(values).all():
        return {"joint": joint, "rms": np.nan, "largest": np.nan, "time": np.nan}
    distance = np.abs(values)
    step, column = np.unravel_index(np.nanargmax(distance), distance.shape)
    return {
        "joint": joint,
        "rms": float(np.sqrt(np.nanmean(values**2))),
        "largest": float(distance[step, column]),
        "time": float(time[step]),
    }
