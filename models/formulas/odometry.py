"""Odometry as formula files hold it: a text that a person reads, whose gain a person may edit.

What it says, `glassgait.models.estimation.odometry` does, and the C of a controller.
"""

from glassgait.models.estimation.imu import GRAVITY
from glassgait.models.estimation.odometry import SLIP, Odometry
from glassgait.models.formulas.program import Number, Program
from glassgait.models.formulas.text import written_number
from glassgait.models.task import CONTROL_PERIOD

_PERIOD, _SLIP = written_number(CONTROL_PERIOD), written_number(SLIP)

_LEGEND = (
    "w: angular velocity, rad/s; dv: what the accelerometer measures, summed over a step, m/s: at",
    "rest 0.196 upward; g: direction of gravity; p: where a foot is, m; dp: how fast its joints",
    "move it, m/s; dr: how fast they turn its shank, rad/s; radius: of a foot, m. By IMU and",
    "joints, in the trunk's frame. The gain in the line of v may be edited: above 0, up to 1.",
)

ODOMETRY = Program(
    title="odometry",
    legend=_LEGEND,
    statements=(
        (
            f"predicted = v - {_PERIOD}*cross(w, v) + dv + {_PERIOD}*{written_number(GRAVITY)}*g",
            "m/s, of the trunk, by the IMU",
        ),
        (
            "sole = dp + cross(w, p) + radius*cross(w + dr, g)",
            "m/s, of each foot's lowest point",
        ),
        ("stood = touching and touching.before", "of each foot: one just come down still moves"),
        (
            f"near = stood and norm(predicted + sole) < {_SLIP}",
            "one that swings or slips is not near",
        ),
        ("standing = near if any(near) else stood", ""),
        ("measured = mean(-sole, standing)", "m/s, of the trunk, by the feet that stand and roll"),
        ("v = predicted + GAIN*(measured - predicted) if any(standing) else predicted", ""),
        (
            f"foothold = p if touching else foothold - {_PERIOD}*(v + cross(w, foothold))",
            "m, of each foot",
        ),
        (
            "normal = unit(cross(foothold.FR - foothold.RL, foothold.FL - foothold.RR))",
            "of the ground",
        ),
        ("h = dot(normal, p - mean(foothold))", "m, each foot's height above that plane"),
    ),
    numbers={"GAIN": Number("the gain", "above 0, up to 1", lambda gain: Odometry(gain=gain))},
)
"""The program, whose one number is `GAIN`."""


def odometry_lines(odometry: Odometry) -> list[str]:
    """Writes odometry, with what its quantities are."""
    return ODOMETRY.lines({"GAIN": odometry.gain})
