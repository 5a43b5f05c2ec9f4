"""Falls and other failures of a robot, which end an episode early."""

from typing import Annotated, ClassVar, Literal

import numpy as np
from annotated_types import Ge, Gt, Interval
from numpy.typing import NDArray

from glassgait.models.arrays import Array, stacked
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.settings import Settings, checked
from glassgait.models.task.ground import LEVEL_GROUND, Ground

FAILURES = (
    "body_contact",
    "low_trunk",
    "joint_limit",
    "abrupt_action",
    "high_foot",
    "lean",
    "not_finite",
)
"""Names of the failures, in the order of `failures`."""


@checked
class TerminationLimits(Settings):
    """Bounds that a robot must keep."""

    title: ClassVar[str] = "limits"

    # Least height of the trunk's centre above the mean ground under the feet (m).
    trunk_height: Annotated[float, Ge(0)] = 0.20
    # Greatest squared change of the action in one step.
    action_change: Annotated[float, Gt(0)] = 60.0
    foot_height: Annotated[float, Gt(0)] = 0.25  # Greatest height of a foot (m).
    # Greatest angle of a joint beyond its range (rad); the plant's limits give way a little.
    joint_overrun: Annotated[float, Ge(0)] = 0.05
    # Share of the calf, from the knee down, whose contact is a failure; the rest may brush the edge
    # of a step.
    shank_share: Annotated[float, Interval(ge=0, le=1)] = 0.5
    # Greatest angle of the trunk to the mean ground (°); 180 for no bound.
    lean: Annotated[float, Interval(gt=0, le=180)] = 180.0


Falls = Literal["task", "physical"]
"""Whether an episode ends by any of the task's failures, or only by a physical fall."""

PHYSICAL_FALL = TerminationLimits(
    trunk_height=0.0,
    action_change=1e6,
    foot_height=1e3,
    joint_overrun=1e3,
    shank_share=0.0,
    lean=60.0,
)
"""A robot has fallen if it lies on its trunk or a thigh, or leans over 60°."""


def failures(
    robot: Robot,
    state: Array,
    *,
    action: Array,
    previous_action: Array,
    limits: TerminationLimits,
    ground: Ground = LEVEL_GROUND,
) -> NDArray[np.bool_]:
    """Returns a flag for each failure in `FAILURES` (..., 7).

    `state` is the plant's x (..., 37) after the step; the action (..., 12) was held during it.
    For a state or action that is not finite, only `not_finite` is set.
    """
    finite = np.all(np.isfinite(state), axis=-1) & np.all(np.isfinite(action), axis=-1)
    state = np.where(finite[..., None], state, 0.0)

    # Joints beyond their ranges, and a jump of the action.
    joint_position = state[..., quadruped.JOINT_POSITION]
    overrun = np.maximum(
        joint_position - robot.upper_limits, robot.lower_limits - joint_position
    ).max(axis=-1)
    change = np.where(finite[..., None], action - previous_action, 0.0)

    # The lowest point of the trunk, the thighs and the calves.
    clearances = ground.clearances(robot, state, limits.shank_share)
    body, calves = np.split(clearances.body, [1 + quadruped.N_LEGS], axis=-1)
    lowest = body.min(axis=-1)
    if limits.shank_share > 0.0:
        # A foot that lands at 2 m/s is 2 cm inside the ground after a step of 10 ms, and the calf
        # with it. On ground without penetration the calf would be higher by as much.
        calves = calves - np.minimum(clearances.feet, 0.0)
        lowest = np.minimum(lowest, calves.min(axis=-1))

    # All failures, in the order of `FAILURES`.
    flags = stacked(
        lowest < 0.0,
        clearances.trunk < limits.trunk_height,
        overrun > limits.joint_overrun,
        np.add.reduce(np.square(change), axis=-1) > limits.action_change,
        clearances.feet.max(axis=-1) > limits.foot_height,
        clearances.upright < np.cos(np.radians(limits.lean)),
    )
    return np.concatenate([flags & finite[..., None], ~finite[..., None]], axis=-1)
