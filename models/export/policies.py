"""The C of every policy but formulas, and of networks."""

import numpy as np

from glassgait.models.export.code import Code, Style, reflection_arrays
from glassgait.models.export.language import CArray, Real, rendered
from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.arrays import lower_neighbours
from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.policies.linear import LinearPolicy
from glassgait.models.policies.neural import MirroredNetwork, Network, NeuralPolicy
from glassgait.models.policies.open_loop import OpenLoopPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.imu import GRAVITY
from glassgait.models.task.odometry import SLIP, Odometry

ABREAST = 10
"""Greatest number of trees that are walked down side by side, so that a processor need not wait."""


def linear_code(policy: LinearPolicy, style: Style) -> Code:
    """Writes weighted sums of the observations, the same always or others in each state."""
    begin, real = style.begin, style.real
    statewise = policy.weights.ndim == 3
    of = "each state and joint" if statewise else "each joint"
    return Code(
        f"Weighted sums of the observation, one for {of}.",
        rendered(
            "linear.c",
            real,
            OWN=begin,
            signature=style.signature(takes_state=statewise),
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


def open_loop_code(policy: OpenLoopPolicy, style: Style) -> Code:
    """Writes a table of actions by state and time in it."""
    begin, real = style.begin, style.real
    return Code(
        "A table of actions, by the machine's state and the control steps in it.",
        rendered(
            "open_loop.c",
            real,
            OWN=begin,
            signature=style.signature(takes_state=True),
            n_iterations=policy.table.shape[1],
        ),
        (CArray.of_reals(f"{begin}ACTIONS", policy.table, real, "actions by state and time"),),
        takes_state=True,
    )


def additive_code(policy: AdditivePolicy, style: Style) -> Code:
    """Writes look-up tables: sums of functions of one observation, and of two."""
    begin, real = style.begin, style.real
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
            own=style.own,
            OWN=begin,
            signature=style.signature(takes_state=False),
            cut_type=cut_type,
            n_cuts=fine.shape[1],
            n_pair_cuts=coarse.shape[1],
            n_pairs=n_pairs,
        ),
        tuple(arrays),
    )


def trees_code(policy: BoostedTreesPolicy, style: Style) -> Code:
    """Writes trees that are walked down, from the root to a leaf, in as many steps always."""
    begin, real = style.begin, style.real
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


def network_code(network: Network | MirroredNetwork, name: str, called: str, real: Real) -> Code:
    """Writes a network.

    Args:
        network: The network.
        name: What its layers are called.
        called: Name of the function that evaluates it: what it reads, then what it writes.
        real: The type that is computed in.
    """
    plain, reflections = network.plain, network.reflections
    prefix = name.upper()
    arrays: list[CArray] = []
    layers = []
    for place, (weight, bias) in enumerate(zip(plain.weights, plain.biases, strict=True), start=1):
        # Of each input what it adds to all outputs stands side by side.
        matrix = CArray.of_reals(
            f"{prefix}_WEIGHTS_{place}", weight.T, real, f"layer {place}: by input and output"
        )
        vector = CArray.of_reals(f"{prefix}_BIASES_{place}", bias, real, f"layer {place}")
        arrays += [matrix, vector]
        n_out, n_in = weight.shape
        layers.append({"n_in": n_in, "n_out": n_out, "weights": matrix.name, "biases": vector.name})
    for what, reflection in zip(("INPUT", "OUTPUT"), reflections, strict=False):
        arrays += reflection_arrays(f"{prefix}_{what}", reflection)
    widths = " - ".join(str(layer["n_out"]) for layer in layers[:-1])
    return Code(
        f"A network of {len(layers)} layers ({widths} hidden units)"
        + (", the mean of itself and its mirror image." if reflections else "."),
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


def odometry_code(odometry: Odometry, robot: Robot, name: str, real: Real) -> str:
    """Writes odometry, line by line as Python has it.

    Args:
        odometry: The odometry.
        robot: The robot, whose lengths are its constants.
        name: What the names of the controller's types begin with.
        real: The type that is computed in.
    """
    return rendered(
        "odometry.c",
        real,
        name=name,
        legs=quadruped.LEGS,
        gain=odometry.gain,
        period=CONTROL_PERIOD,
        gravity=GRAVITY,
        slip=SLIP,
        thigh=robot.thigh_length,
        calf=robot.calf_length,
        radius=robot.foot_radius,
        offset=(robot.side * robot.thigh_offset).tolist(),
        hip=robot.hip_origin.tolist(),
    )


def neural_code(policy: NeuralPolicy, style: Style) -> Code:
    """Writes the network that acts."""
    return network_code(policy.actor, f"{style.own}actor", f"{style.own}act", style.real)
