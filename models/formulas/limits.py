"""Limits of targets as formula files hold them, with three numbers that a person may edit.

What the program says, `glassgait.models.robots.target_limits` does, and the C of a controller.
"""

from collections.abc import Mapping

from glassgait.models.formulas.program import Number, Program
from glassgait.models.robots.target_limits import TargetLimits

_LEGEND = (
    "asked: what a formula asks for; before: target of the step before; q: angle of the joint,",
    "rad. torque: greatest of its motor, N m; lowest, highest: ends of its range, rad. Where not",
    "all that is asked is finite, every joint keeps its target. Three numbers may be edited: what",
    "torque is divided by, the joints' stiffness (N m/rad) or more; the lean in cos, in degrees;",
    "the margin at the ends of the range, rad.",
)

LIMITS = Program(
    title="limits",
    legend=_LEGEND,
    statements=(
        ("reach = torque/STIFFNESS", "rad, at which a motor at rest gives all that it has"),
        (
            "wanted = asked if g.z < -cos(LEAN) else q",
            "beyond that lean: to where the joint is, and damped",
        ),
        ("weak = clip(wanted, q - reach, q + reach)", ""),
        ("slow = clip(weak, before - reach, before + reach)", "by reach a step at most"),
        ("target = clip(slow, lowest + MARGIN, highest - MARGIN)", ""),
    ),
    numbers={
        "STIFFNESS": Number("the stiffness", "from 0.01 to 1000", TargetLimits),
        "LEAN": Number("the lean", "above 0, up to 90", lambda lean: TargetLimits(1.0, lean=lean)),
        "MARGIN": Number(
            "the margin", "from 0 to 0.2", lambda margin: TargetLimits(1.0, margin=margin)
        ),
    },
)
"""The program, whose numbers are `STIFFNESS`, `LEAN` and `MARGIN`."""


def limits_lines(limits: TargetLimits) -> list[str]:
    """Writes limits, with what their quantities are."""
    return LIMITS.lines(
        {"STIFFNESS": limits.stiffness, "LEAN": limits.lean, "MARGIN": limits.margin}
    )


def limits_of(numbers: Mapping[str, float]) -> TargetLimits:
    """Returns the limits that a program with these numbers is."""
    return TargetLimits(numbers["STIFFNESS"], margin=numbers["MARGIN"], lean=numbers["LEAN"])
