"""Tables of what was proved."""

from collections.abc import Sequence

import pandas as pd

from glassgait.models.certificates.prover import Prover, Verdict
from glassgait.models.robots import quadruped


def claims_table(verdicts: Sequence[Verdict]) -> pd.DataFrame:
    """Returns a row a claim: whether it holds, and what comes closest to breaking it."""
    return pd.DataFrame(
        [
            {
                "claim": verdict.claim.name,
                "outcome": verdict.outcome,
                "worst": verdict.worst,
                "claimed": verdict.claimed,
                "where": verdict.where,
            }
            for verdict in verdicts
        ],
        columns=["claim", "outcome", "worst", "claimed", "where"],
    )


def bounds_table(prover: Prover) -> pd.DataFrame:
    """Returns a row a box, state and joint: how far the target can go, and how sure that is."""
    rows, robot = [], prover.policy.robot
    for box in prover.boxes:
        for state, name in enumerate(prover.gait.states):
            for joint, title in enumerate(quadruped.JOINTS):
                above, below = prover.range_of(state, joint, box)
                width = robot.upper_limits[joint] - robot.lower_limits[joint]
                rows.append(
                    {
                        "box": box,
                        "state": name,
                        "joint": title,
                        "least (rad)": -below.bound,
                        "greatest (rad)": above.bound,
                        "gap (% of range)": 100.0 * max(above.gap, below.gap) / width,
                        "cells": above.found.n_cells + below.found.n_cells,
                    }
                )
    return pd.DataFrame(rows)
