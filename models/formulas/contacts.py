"""Which contact sensors are believed, as formula files hold it: a text that a person reads.

What it says, `glassgait.models.estimation.contact.ContactTrust` does, and the C of a controller.
"""

from glassgait.models.estimation.contact import LOW, UNCHANGED_STEPS
from glassgait.models.formulas.program import Program
from glassgait.models.formulas.text import written_number
from glassgait.models.task import CONTROL_PERIOD

_LEGEND = (
    "sensed: whether a foot presses on the ground, by its sensor; expected: how high it is over",
    "odometry's ground of the step before, m. Of each foot.",
)

CONTACTS = Program(
    title="contacts",
    legend=_LEGEND,
    statements=(
        (
            f"unchanged = min(unchanged + 1, {UNCHANGED_STEPS}) if sensed == sensed.before else 0",
            "control steps",
        ),
        (
            f"stuck = unchanged == {UNCHANGED_STEPS}",
            f"for {written_number(UNCHANGED_STEPS * CONTROL_PERIOD)} s, longer than a gait holds a "
            "foot up or down",
        ),
        (f"low = expected < {written_number(LOW)}", ""),
        ("touching = low if stuck else sensed", "by this odometry goes"),
        ("contact = low if stuck else sensed or sensed.before", "and by this the machine"),
    ),
)
"""The program, of which no number may be edited."""
