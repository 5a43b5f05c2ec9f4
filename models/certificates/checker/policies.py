"""Reading policies: what their files say, as polynomials of quantities in the robot's units."""

import ast
import json
import re
import struct
from itertools import product as ways

import numpy as np

from .polynomials import (
    RefusedError,
    applied,
    constant,
    exact,
    names_in,
    plus,
    quantity,
    refuse_unless,
    substituted,
    times,
)

# The robot, restated: a check that asked the prover for these would check less.
LEGS, PARTS = ("FL", "FR", "RL", "RR"), ("hip", "thigh", "calf")
JOINTS = [f"{leg}_{part}" for leg in LEGS for part in PARTS]
STANCE = [0.1, 0.8, -1.5, -0.1, 0.8, -1.5, 0.1, 1.0, -1.5, -0.1, 1.0, -1.5]
ACTION_SCALE = 0.25
MIRRORED = {"FL": "FR", "FR": "FL", "RL": "RR", "RR": "RL"}
FUNCTIONS = ("sin", "cos", "tanh", "exp", "log", "sqrt", "abs")


def read_policy(data: bytes, kind: str, n_states: int, gait: str) -> list[list[dict]]:
    """Returns the targets (rad) of each state and joint, as polynomials of quantities."""
    if kind in ("symbolic", "statewise_symbolic"):
        return read_formulas(data.decode(), n_states, gait)
    refuse_unless(
        kind in ("linear", "statewise_linear"),
        f"a policy of kind {kind!r} is not checked; formulas and linear ones are",
    )
    return read_linear(data, n_states, gait)


def read_formulas(text: str, n_states: int, gait: str) -> list[list[dict]]:
    """Reads a formula file, statement by statement."""
    joined = re.sub(r"\n[ \t]+", " ", re.sub(r"#[^\n]*", "", text))
    header, rows, section = {}, {}, ""
    known = {name: quantity(name) for name in symbols(n_states)}
    for line in filter(None, map(str.strip, joined.split("\n"))):
        if line in ("definitions", "every state") or re.fullmatch(r"state \d+", line):
            section = line
        elif not section:
            key, _, value = line.partition(":")
            header[key] = value.strip()
        else:
            name, _, formula = line.partition("=")
            read = parsed(ast.parse(formula.strip(), mode="eval").body, known)
            if section == "definitions":
                known = {**known, name.strip(): read}
            else:
                states = range(n_states) if section == "every state" else [int(section[6:])]
                rows |= {(state, name.strip()): read for state in states}
    refuse_unless(header.get("gait") == gait, "the policy is of another gait")
    refuse_unless(header.get("states") == str(n_states), "the policy has other states")
    if "mirror" in header:
        image = [int(state) for state in header["mirror"].split()]
        for (state, joint), formula in list(rows.items()):
            place = image[state], f"{MIRRORED[joint[:2]]}{joint[2:]}"
            rows.setdefault(place, mirrored(formula, joint, image))
    return [[rows[state, joint] for joint in JOINTS] for state in range(n_states)]


def parsed(node: ast.expr, known: dict[str, dict]) -> dict:
    match node:
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
            return constant(exact(value))
        case ast.Name() | ast.Attribute():
            return known[ast.unparse(node)]
        case ast.UnaryOp(op=ast.USub() | ast.UAdd() as sign, operand=inner):
            factor = -1 if isinstance(sign, ast.USub) else 1
            return plus({}, parsed(inner, known), factor)
        case ast.BinOp(left=left, op=ast.Pow(), right=ast.Constant(value=2 | 3 as power)):
            whole = one = parsed(left, known)
            for _ in range(1 if power == 2 else 2):
                whole = times(whole, one)
            return whole
        case ast.BinOp(left=left, op=operator, right=right):
            a, b = parsed(left, known), parsed(right, known)
            match operator:
                case ast.Add() | ast.Sub():
                    return plus(a, b, 1 if isinstance(operator, ast.Add) else -1)
                case ast.Mult():
                    return times(a, b)
                case ast.Div():
                    return times(a, applied("inverse", b))
        case ast.Call(func=ast.Name(id=name), args=[inner], keywords=[]) if name in FUNCTIONS:
            return applied(name, parsed(inner, known))
    raise RefusedError(f"{ast.unparse(node)!r} is no formula")


def mirrored(formula: dict, joint: str, image: list[int]) -> dict:
    """Returns what the formula of a joint is for the joint's image."""
    put = {}
    for name in names_in(formula):
        new = re.sub(r"\.(FL|FR|RL|RR)", lambda leg: f".{MIRRORED[leg[1]]}", name)
        new = re.sub(r"^s(\d+)$", lambda state: f"s{image[int(state[1])]}", new)
        turned = name.endswith("_hip") or name in ("cmd.yaw", "v.y")
        put[name] = plus({}, quantity(new), -1 if turned else 1)
    return plus({}, substituted(formula, put), -1 if joint.endswith("_hip") else 1)


def symbols(n_states: int) -> list[str]:
    """Names the quantities in the order of the observation."""
    of_joints = [f"{kind}.{joint}" for kind in ("q", "dq", "a") for joint in JOINTS]
    last = ["t", "cmd.t", "v.x", "v.y", "v.z", *(f"h.{leg}" for leg in LEGS)]
    return ["cmd.v", "cmd.yaw", *of_joints, *(f"s{i}" for i in range(n_states)), *last]


def read_linear(data: bytes, n_states: int, gait: str) -> list[list[dict]]:
    """Reads weights and intercepts from a safetensors file; observations are scaled quantities."""
    (size,) = struct.unpack("<Q", data[:8])
    header = json.loads(data[8 : 8 + size])
    told = json.loads(header.pop("__metadata__")["header"])
    names = symbols(n_states)
    refuse_unless(told["gait"] == gait, "the policy is of another gait")
    refuse_unless(len(told["observation_names"]) == len(names), "the policy observes other things")
    arrays = {}
    for name, own in header.items():
        start, end = own["data_offsets"]
        kind = {"F64": "<f8", "F32": "<f4", "F16": "<f2"}[own["dtype"]]
        flat = np.frombuffer(data[8 + size + start : 8 + size + end], kind)
        arrays[name] = flat.astype(float).reshape(own["shape"])
    weights = np.broadcast_to(arrays["weights"], (n_states, 12, len(names)))
    intercepts = np.broadcast_to(arrays["intercepts"], (n_states, 12))
    scales = {"dq": 0.05, "a": 1.0 / ACTION_SCALE, "t": 0.1, "v": 2.0}
    rows = []
    for state, joint in ways(range(n_states), range(12)):
        whole = constant(exact(intercepts[state, joint]))
        for name, weight in zip(names, weights[state, joint].tolist(), strict=True):
            kind, _, part = name.partition(".")
            scale = 0.1 if name == "cmd.t" else scales.get(kind, 1.0)
            offset = STANCE[JOINTS.index(part)] if kind in ("q", "a") else 0.0
            scaled = plus(quantity(name), constant(exact(offset)), -1)
            whole = plus(whole, scaled, exact(weight) * exact(scale))
        target = plus(constant(exact(STANCE[joint])), whole, exact(ACTION_SCALE))
        rows.append(target)
    return [rows[start : start + 12] for start in range(0, len(rows), 12)]
