"""The C of additive models: look-up tables of one observation and of two."""

import numpy as np

from glassgait.models.export.code import Code, act_signature
from glassgait.models.export.language import CArray, Real, rendered
from glassgait.models.policies.additive import AdditivePolicy


def additive_code(policy: AdditivePolicy, real: Real, own: str = "") -> Code:
    """Writes sums of functions of one observation, and of two; see `formula_code`."""
    begin = own.upper()
    # What an observation adds to all joints stands side by side: (n, bins, 12).
    effects = np.moveaxis(policy.tables, 0, -1)
    pairs = np.column_stack([policy.pairs, policy.pair_joints])
    n_pairs = len(pairs)
    fine, coarse = policy.cuts, policy.pair_cuts
    # One function searches both, so that both are of the type that holds both.
    cut_type = CArray.of_reals("", np.concatenate([fine.ravel(), coarse.ravel()]), real, "").type
    arrays = [
        CArray(f"{begin}CUTS", fine, cut_type, "cuts of each observation, ascending"),
        CArray.of_reals(f"{begin}EFFECTS", effects, real, "gain of all joints, by bin"),
        CArray.of_reals(f"{begin}INTERCEPTS", policy.intercepts, real, "constant of each joint"),
    ]
    if n_pairs:
        arrays += [
            CArray(f"{begin}PAIR_CUTS", coarse, cut_type, "coarser cuts, for pairs"),
            CArray.of_indices(f"{begin}PAIRS", pairs, "two observations, and the joint that gains"),
            CArray.of_reals(
                f"{begin}PAIR_EFFECTS", policy.pair_tables, real, "its gain, by both bins"
            ),
        ]
    return Code(
        f"A sum of {effects.shape[0]} functions of one observation a joint, and in all {n_pairs} "
        "of two.",
        rendered(
            "additive.c",
            real,
            own=own,
            OWN=begin,
            signature=act_signature(own, real, takes_state=False),
            cut_type=cut_type,
            n_cuts=fine.shape[1],
            n_pair_cuts=coarse.shape[1],
            n_pairs=n_pairs,
        ),
        tuple(arrays),
    )
