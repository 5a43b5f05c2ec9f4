"""The C of networks, and of networks that treat left and right alike."""

import numpy as np

from glassgait.models.export.code import Code
from glassgait.models.export.language import CArray, Real, rendered
from glassgait.models.policies.neural import MirroredNetwork, Network
from glassgait.models.task.symmetry import Reflection


def network_code(network: Network | MirroredNetwork, name: str, called: str, real: Real) -> Code:
    """Writes a network.

    Args:
        network: The network.
        name: What its layers are called.
        called: Name of the function that evaluates it: what it reads, then what it writes.
        real: The type that is computed in.
    """
    mirrored = isinstance(network, MirroredNetwork)
    plain = network.network if mirrored else network
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
    if mirrored:
        arrays += _reflection(f"{prefix}_INPUT", network.reflect_input)
        arrays += _reflection(f"{prefix}_OUTPUT", network.reflect_output)
    widths = " - ".join(str(layer["n_out"]) for layer in layers[:-1])
    return Code(
        f"A network of {len(layers)} layers ({widths} hidden units)"
        + (", the mean of itself and its mirror image." if mirrored else "."),
        rendered(
            "network.c",
            real,
            name=name,
            called=called,
            layers=layers,
            n_hidden=max((layer["n_out"] for layer in layers[:-1]), default=1),
            mirrored=mirrored,
        ),
        tuple(arrays),
    )


def _reflection(prefix: str, reflection: Reflection) -> list[CArray]:
    index, sign = reflection.index, reflection.sign.astype(np.float32)
    return [
        CArray.of_indices(f"{prefix}_IMAGE", index, "in the mirror an entry is this one"),
        CArray(f"{prefix}_SIGN", sign, "float", "times this sign"),
    ]
