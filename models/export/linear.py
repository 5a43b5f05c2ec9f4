"""The C of linear policies and of open-loop tables."""

from glassgait.models.export.code import Code, act_signature
from glassgait.models.export.language import CArray, Real, rendered
from glassgait.models.policies.linear import LinearPolicy, StatewiseLinearPolicy
from glassgait.models.policies.open_loop import OpenLoopPolicy


def linear_code(policy: LinearPolicy | StatewiseLinearPolicy, real: Real, own: str = "") -> Code:
    """Writes weighted sums of the observations, the same always or others in each state; see
    `formula_code`."""
    begin = own.upper()
    statewise = isinstance(policy, StatewiseLinearPolicy)
    of = "each state and joint" if statewise else "each joint"
    return Code(
        f"Weighted sums of the observation, one for {of}.",
        rendered(
            "linear.c",
            real,
            OWN=begin,
            signature=act_signature(own, real, takes_state=statewise),
            statewise=statewise,
        ),
        (
            CArray.of_reals(
                f"{begin}WEIGHTS", policy.weights, real, f"weight of each observation, {of}"
            ),
            CArray.of_reals(f"{begin}INTERCEPTS", policy.intercepts, real, f"constant of {of}"),
        ),
        takes_state=statewise,
    )


def open_loop_code(policy: OpenLoopPolicy, real: Real, own: str = "") -> Code:
    """Writes a table of actions by state and time in it; see `formula_code`."""
    begin = own.upper()
    return Code(
        "A table of actions, by the machine's state and the control steps in it.",
        rendered(
            "open_loop.c",
            real,
            OWN=begin,
            signature=act_signature(own, real, takes_state=True),
            n_iterations=policy.table.shape[1],
        ),
        (CArray.of_reals(f"{begin}ACTIONS", policy.table, real, "actions by state and time"),),
        takes_state=True,
    )
