"""The C of boosted trees."""

from glassgait.models.export.code import Code, act_signature
from glassgait.models.export.language import CArray, Real, rendered
from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.policies.precision import lower_neighbours

ABREAST = 10
"""Greatest number of trees that are walked down side by side, so that a processor need not wait."""


def trees_code(policy: BoostedTreesPolicy, real: Real, own: str = "") -> Code:
    """Writes trees that are walked down, from the root to a leaf, in as many steps always; see
    `formula_code`."""
    begin = own.upper()
    # Cuts of trees that round what they compare are compared with what is rounded.
    rounded = lower_neighbours(policy.thresholds)
    thresholds = policy.thresholds if rounded is None else rounded
    n_trees = policy.features.shape[1]
    arrays = (
        CArray.of_indices(f"{begin}QUESTIONS", policy.features, "observation that a node asks for"),
        CArray.of_reals(f"{begin}THRESHOLDS", thresholds, real, "above it, a node goes right"),
        CArray.of_reals(f"{begin}LEAVES", policy.leaves, real, "what a leaf adds to the action"),
        CArray.of_reals(f"{begin}INTERCEPTS", policy.intercepts, real, "constant of each joint"),
    )
    return Code(
        f"A sum of {n_trees} trees a joint, of {policy.depth} questions each.",
        rendered(
            "trees.c",
            real,
            OWN=begin,
            signature=act_signature(own, real, takes_state=False),
            n_trees=n_trees,
            depth=policy.depth,
            abreast=max(k for k in range(1, ABREAST + 1) if n_trees % k == 0),
            compared=arrays[1].type if rounded is not None else real,
            question_type=arrays[0].type,
            threshold_type=arrays[1].type,
            leaf_type=arrays[2].type,
        ),
        arrays,
    )
