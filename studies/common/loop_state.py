"""What the closed loop remembers from one control step to the next, but for the machine's state."""

import numpy as np

from glassgait.diagrams.task_state import TaskState
from glassgait.models.arrays import Array
from glassgait.models.robots import quadruped
from glassgait.models.robots.heading_frame import COORDINATES, to_heading_frame

NAMES = (*COORDINATES, *(f"previous action {joint}" for joint in quadruped.JOINTS))
"""What plant and policy remember, seen from where the robot is and where it faces.

Contacts follow from the pose, and what a learned estimator returns from all of these: neither
remembers more. Odometry does, see `ODOMETRY_NAMES`. Place and heading are left out, for nothing
depends on them.
"""

ODOMETRY_NAMES = (
    *(f"odometry {axis} speed" for axis in ("forward", "lateral", "vertical")),
    *(f"odometry foothold {leg} {axis}" for leg in quadruped.LEGS for axis in "xyz"),
)
"""What odometry remembers beside that, in the trunk's frame; which feet touch follows from the
pose."""

UNITS: Array = np.concatenate(
    [
        [0.01, 0.05, 0.05],
        np.full(quadruped.N_JOINTS, 0.05),
        np.full(3, 0.5),
        np.full(3, 0.1),
        np.full(quadruped.N_JOINTS, 1.0),
        np.full(quadruped.N_JOINTS, 0.2),
    ]
)
"""What each coordinate is counted in (45; m, rad, rad/s, m/s, actions): part of a gait's sway."""
UNITS.flags.writeable = False

ODOMETRY_UNITS: Array = np.repeat([0.1, 0.01], [3, 3 * quadruped.N_LEGS])
"""The same of `ODOMETRY_NAMES` (15; m/s, m)."""
ODOMETRY_UNITS.flags.writeable = False


def loop_state(state: TaskState) -> Array:
    """Returns what `NAMES` and `ODOMETRY_NAMES` name of each robot, in their units (n, 60)."""
    footholds = state.odometry.footholds.reshape(-1, 3 * quadruped.N_LEGS)
    plant_and_policy = np.concatenate([to_heading_frame(state.plant), state.action], axis=1)
    odometry = np.concatenate([state.odometry.velocity, footholds], axis=1)
    return np.concatenate([plant_and_policy / UNITS, odometry / ODOMETRY_UNITS], axis=1)
