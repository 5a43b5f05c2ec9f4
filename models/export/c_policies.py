"""Writes policies, by kind, and networks as C."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import singledispatch
from typing import NamedTuple

import numpy as np

from glassgait.models.errors import InputError
from glassgait.models.export.c_language import LINE_LENGTH, CArray, Real, rendered
from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.boosting import BoostedTreesPolicy, lower_neighbours
from glassgait.models.policies.linear import LinearPolicy
from glassgait.models.policies.neural import Network, NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.task.observation import Reflection

ABREAST = 10  # greatest number of trees evaluated side by side, so that the processor does not wait


@dataclass(frozen=True)
class Code:
    title: str
    functions: str  # C functions; the last one is the entry point
    arrays: tuple[CArray, ...] = ()  # constant arrays, whose numbers are at the end of the file
    takes_state: bool = False  # whether the first argument of the last function is the RM state


class Style(NamedTuple):
    """Names of the C constants of RM states, and the type to compute in."""

    constants: Sequence[str]
    real: Real

    def signature(self, *, takes_state: bool, name: str = "act", writes: str = "action") -> str:
        begin = f"static void {name}({'int state, ' if takes_state else ''}"
        observed = f"const {self.real} observation[N_OBSERVATIONS],"
        rest = f"{self.real} {writes}[12])"
        whole = f"{begin}{observed} {rest}"
        return whole if len(whole) <= LINE_LENGTH else f"{begin}{observed}\n    {rest}"


@singledispatch
def policy_code(policy: Policy, style: Style) -> Code:
    """Writes a policy; its last function maps the observation to the action."""
    raise InputError(f"there is no C for policies of kind {policy.kind!r}; export another one")


@policy_code.register
def _(policy: LinearPolicy, style: Style) -> Code:
    real, per_state = style.real, policy.weights.ndim == 3
    of = "each state and joint" if per_state else "each joint"
    return Code(
        f"Weighted sums of the observation, one for {of}.",
        rendered(
            "linear.c", real, signature=style.signature(takes_state=per_state), per_state=per_state
        ),
        (
            CArray.of_reals("WEIGHTS", policy.weights, real, f"weight of each observation, {of}"),
            CArray.of_reals("INTERCEPTS", policy.intercepts, real, f"constant of {of}"),
        ),
        takes_state=per_state,
    )


@policy_code.register
def _(policy: AdditivePolicy, style: Style) -> Code:
    real = style.real
    # Put the effects of one bin on all joints side by side: (n, bins, 12).
    effects = np.moveaxis(policy.tables, 0, -1)
    pairs = np.column_stack([policy.pairs, policy.pair_joints])
    n_pairs = len(pairs)

    # Only pairs need the coarse cuts. One C function searches both, so both have the same type.
    fine, coarse = policy.cuts, policy.pair_cuts
    cut_type = CArray.of_reals("", np.concatenate([fine.ravel(), coarse.ravel()]), real, "").type
    arrays = [
        CArray("CUTS", fine, cut_type, "cuts of each observation, ascending"),
        CArray.of_reals("EFFECTS", effects, real, "effect on all joints, by bin"),
        CArray.of_reals("INTERCEPTS", policy.intercepts, real, "constant of each joint"),
    ]
    if n_pairs:
        arrays += [
            CArray("PAIR_CUTS", coarse, cut_type, "coarser cuts, for pairs"),
            CArray.of_indices("PAIRS", pairs, "two observations, and a joint"),
            CArray.of_reals("PAIR_EFFECTS", policy.pair_tables, real, "effect on it, by both bins"),
        ]
    return Code(
        f"A sum of {effects.shape[0]} functions of one observation per joint, and {n_pairs} "
        "functions of two in total.",
        rendered(
            "additive.c",
            real,
            signature=style.signature(takes_state=False),
            cut_type=cut_type,
            n_cuts=fine.shape[1],
            n_pair_cuts=coarse.shape[1],
            n_pairs=n_pairs,
        ),
        tuple(arrays),
    )


@policy_code.register
def _(policy: BoostedTreesPolicy, style: Style) -> Code:
    real = style.real
    # Trees that round observations before comparing them do so in C, too.
    rounded = lower_neighbours(policy.thresholds)
    thresholds = policy.thresholds if rounded is None else rounded
    n_trees = policy.features.shape[1]
    arrays = (
        CArray.of_indices("QUESTIONS", policy.features, "observation that a node compares"),
        CArray.of_reals("THRESHOLDS", thresholds, real, "a node goes right if it is greater"),
        CArray.of_reals("LEAVES", policy.leaves, real, "value that a leaf adds to the action"),
        CArray.of_reals("INTERCEPTS", policy.intercepts, real, "constant of each joint"),
    )
    return Code(
        f"A sum of {n_trees} trees per joint, with {policy.depth} comparisons each.",
        rendered(
            "trees.c",
            real,
            signature=style.signature(takes_state=False),
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


@policy_code.register
def _(policy: NeuralPolicy, style: Style) -> Code:
    return network_code(policy.actor, "actor", "act", style.real)


def network_code(network: Network, name: str, called: str, real: Real) -> Code:
    """Writes a network as the function `called`; the names of its layers begin with `name`."""
    # Write the layers, with the weights of one input for all outputs side by side.
    reflections, prefix = network.reflections or (), name.upper()
    arrays: list[CArray] = []
    layers, layered = [], zip(network.weights, network.biases, strict=True)
    for place, (weight, bias) in enumerate(layered, start=1):
        matrix = CArray.of_reals(
            f"{prefix}_WEIGHTS_{place}", weight.T, real, f"layer {place}: by input and output"
        )
        vector = CArray.of_reals(f"{prefix}_BIASES_{place}", bias, real, f"layer {place}")
        arrays += [matrix, vector]
        n_out, n_in = weight.shape
        layers.append({"n_in": n_in, "n_out": n_out, "weights": matrix.name, "biases": vector.name})

    # Write the reflections of input and output, and the functions.
    for side, reflection in zip(("INPUT", "OUTPUT"), reflections, strict=False):
        arrays += reflection_arrays(f"{prefix}_{side}", reflection)
    widths = " - ".join(str(layer["n_out"]) for layer in layers[:-1])
    return Code(
        f"A network of {len(layers)} layers ({widths} hidden units)"
        + (", averaged with its mirror image." if reflections else "."),
        rendered(
            "network.c",
            real,
            name=name,
            called=called,
            layers=layers,
            n_hidden=max((layer["n_out"] for layer in layers[:-1]), default=1),
            mirrored=bool(reflections),
        ),
        tuple(arrays),
    )


def reflection_arrays(prefix: str, reflection: Reflection) -> list[CArray]:
    """Writes the reflection of a vector as two arrays, whose names begin with the prefix."""
    index, sign = reflection.index, reflection.sign.astype(np.int8)
    return [
        CArray.of_indices(f"{prefix}_IMAGE", index, "the mirror image of an entry is this one"),
        CArray(f"{prefix}_SIGN", sign, "signed char", "times this sign"),
    ]
