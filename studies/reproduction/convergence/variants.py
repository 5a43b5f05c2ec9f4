"""The solvers and steps that are compared."""

from dataclasses import dataclass

from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.station import ContactSolver, StationConfig

DRAKES_RELAXATION_TIME = 0.2
"""What two bodies without a relaxation time of their own add up to in SAP (s)."""


@dataclass(frozen=True)
class Variant:
    """One way of simulating contact.

    Attributes:
        family: The solver, as figures call it.
        resolution: Time step (s), or accuracy of the error-controlled integrator.
        scenario: The world.
    """

    family: str
    resolution: float
    scenario: Scenario


def _discrete(
    family: str,
    solver: ContactSolver,
    *steps: float,
    relaxation_time: float = StationConfig.relaxation_time,
) -> list[Variant]:
    return [
        Variant(
            family,
            step,
            Scenario(
                f"{family} {1000 * step:g} ms",
                StationConfig(step, solver, relaxation_time=relaxation_time),
            ),
        )
        for step in steps
    ]


SAP = "SAP"
SAP_DEFAULT = "SAP, Drake's relaxation"
CENIC = "CENIC"

VARIANTS = (
    *_discrete(SAP, "sap", 0.02, 0.01, 0.005, 0.002, 0.001),
    *_discrete(
        SAP_DEFAULT,
        "sap",
        *(0.02, 0.01, 0.005, 0.002, 0.001),
        relaxation_time=DRAKES_RELAXATION_TIME,
    ),
    *_discrete("similar", "similar", 0.02, 0.01, 0.005, 0.002, 0.001),
    *_discrete("lagged", "lagged", 0.02, 0.01, 0.005, 0.002, 0.001, 0.0005),
    *(
        Variant(
            CENIC,
            accuracy,
            Scenario(f"CENIC {accuracy:g}", StationConfig(time_step=0.0), accuracy, max_robots=1),
        )
        for accuracy in (1e-2, 1e-3, 1e-4, 1e-5)
    ),
)
