"""Converts rsl_rl checkpoints (.pt) to ONNX; reads only tensors, so that no code can run."""

import re
from collections.abc import Mapping
from io import BytesIO
from typing import Any
from warnings import catch_warnings

import numpy as np

from glassgait.models.errors import InputError, brief, shown

OPSET, IR_VERSION = 17, 8  # of ONNX; runtimes since 2022 support them
MARGIN = 0.01  # rsl_rl adds it to the standard deviations of observations

_PREFIX = re.compile(r"(actor|mlp|obs_normalizer|actor_obs_normalizer)\.")
_KNOWN = re.compile(r"\d+\.(weight|bias)|_mean|_std|_var|count|critic.*|(log_)?std|distribution.*")


def network_of_checkpoint(data: bytes, *, name: str, activation: str, size: int) -> bytes:
    """Returns the ONNX file of a checkpoint's actor, including its observation normaliser.

    `activation` is ONNX's name of the function between layers, such as `Elu`. Raises an InputError
    if the file is TorchScript or not a plain actor; it has the command that exports a network of
    `size` inputs.
    """
    import torch  # noqa: PLC0415

    # rsl_rl 1 to 4 saves actor and critic together; rsl_rl 5 saves the actor separately.
    try:
        with catch_warnings(action="ignore"):
            saved = torch.load(BytesIO(data), map_location="cpu", weights_only=True)
            actor = saved.get("actor_state_dict") or saved.get("model_state_dict") or saved
            parts = {**actor, **saved.get("obs_norm_state_dict", {})}
            named = {
                _PREFIX.sub("", key, count=1): tensor.detach().double().numpy()
                for key, tensor in parts.items()
            }
            return _network(named, activation)
    except Exception as error:
        # Only the first sentence of PyTorch's, which goes on to advise against safety.
        problem = brief(str(error).partition(". ")[0])
        raise InputError(
            f"weights {shown(name)} is no checkpoint of tensors ({problem}); give an ONNX file, as "
            f"written by 'torch.onnx.export(torch.jit.load({name!r}), torch.zeros(1, {size}), "
            "'policy.onnx', dynamo=False)'"
        ) from error


def _network(named: Mapping[str, Any], activation: str) -> bytes:
    from onnx import TensorProto, helper, numpy_helper  # noqa: PLC0415

    # Find the layers.
    unknown = [name for name in named if not _KNOWN.fullmatch(name)]
    numbers = [int(name.split(".")[0]) for name in named if name[:1].isdigit()]
    layers = sorted({*numbers})
    if unknown or not layers or len(numbers) != 2 * len(layers):
        raise InputError(f"it has {shown((unknown or [*named])[:1])}, so it is no actor of rsl_rl")
    weights, biases = ([named[f"{i}.{part}"] for i in layers] for part in ("weight", "bias"))

    # Fold the normaliser into the first layer.
    if "_mean" in named:
        weights[0] = weights[0] / (named["_std"] + MARGIN)
        biases[0] = biases[0] - weights[0] @ named["_mean"].ravel()
    nodes, constants = [], []
    for i, values in enumerate(zip(weights, biases, strict=True)):
        names = [f"weight_{i}", f"bias_{i}"]
        constants += map(numpy_helper.from_array, (x.astype(np.float32) for x in values), names)
        nodes.append(helper.make_node("Gemm", [f"x_{i}", *names], [f"y_{i}"], transB=1))
        nodes.append(helper.make_node(activation, [f"y_{i}"], [f"x_{i + 1}"]))
    given, answer = (
        helper.make_tensor_value_info(name, TensorProto.FLOAT, ["robots", size])
        for name, size in (("x_0", weights[0].shape[1]), (f"y_{len(layers) - 1}", len(biases[-1])))
    )
    graph = helper.make_graph(nodes[:-1], "actor", [given], [answer], constants)
    opsets = [helper.make_opsetid("", OPSET)]
    model = helper.make_model(graph, opset_imports=opsets, ir_version=IR_VERSION)
    return model.SerializeToString(deterministic=True)
