"""The robot, restated: a check that asked the prover for these numbers would check less."""

import re
from typing import Any, NamedTuple

LEGS, PARTS = ("FL", "FR", "RL", "RR"), ("hip", "thigh", "calf")
JOINTS = [f"{leg}_{part}" for leg in LEGS for part in PARTS]
STANCE = [0.1, 0.8, -1.5, -0.1, 0.8, -1.5, 0.1, 1.0, -1.5, -0.1, 1.0, -1.5]
LIMITS = {"hip": (-0.8029, 0.8029), "thigh": (-1.0472, 4.1888), "calf": (-2.6965, -0.9163)}
ACTION_SCALE, STIFFNESS, EFFORT, ABRUPT = 0.25, 20.0, 33.5, 60.0
ANGLE_OVERRUN, OVERDUE = 0.06, 2
FASTEST_JOINT, FASTEST_TRUNK, FOOT_HEIGHTS = 50.0, 3.0, (-0.1, 0.4)
MIRRORED = {"FL": "FR", "FR": "FL", "RL": "RR", "RR": "RL"}
COUNTED = ("t", "cmd.t")

Box = dict[str, tuple[float, float]]


class BoundQuery(NamedTuple):
    """What is bounded: a joint's target, or what follows from it, times a sign."""

    of: str
    state: int
    joint: str
    sign: int
    name: str | None = None


class RefusedError(Exception):
    """A certificate that does not hold; the reason is one sentence."""


def refuse_unless(holds: Any, sentence: str) -> None:
    """Refuses what does not hold."""
    if not holds:
        raise RefusedError(sentence)


def symbols(n_states: int) -> list[str]:
    """Names the quantities in the order of the observation."""
    of_joints = [f"{kind}.{joint}" for kind in ("q", "dq", "a") for joint in JOINTS]
    last = ["t", "cmd.t", "v.x", "v.y", "v.z", *(f"h.{leg}" for leg in LEGS)]
    return ["cmd.v", "cmd.yaw", *of_joints, *(f"s{i}" for i in range(n_states)), *last]


def observed_names(n_states: int) -> list[str]:
    """Names the observations as policies of arrays do, in their order."""
    titles = [f"{leg} {part.capitalize()}" for leg in LEGS for part in PARTS]
    of_joints = [
        f"{kind} {title}" for kind in ("DoF Pos", "DoF Vel", "Prev Action") for title in titles
    ]
    states = [f"RM State {i}" for i in range(n_states)]
    last = [f"Base Lin Vel {axis}" for axis in "XYZ"] + [f"Foot Height {leg}" for leg in LEGS]
    return ["Command X", "Command Yaw", *of_joints, *states, "RM Iters", "Command RM Iters", *last]


def units(name: str) -> tuple[float, float]:
    """Returns scale and offset of a quantity: it is observed as (quantity - offset) * scale."""
    kind, _, joint = name.partition(".")
    scales = {"dq": 0.05, "a": 1.0 / ACTION_SCALE, "t": 0.1, "v": 2.0}
    scale = 0.1 if name == "cmd.t" else scales.get(kind, 1.0)
    return scale, STANCE[JOINTS.index(joint)] if kind in ("q", "a") else 0.0


def image_of(name: str, image: list[int]) -> tuple[str, int]:
    """Returns what a quantity or a joint is in the mirror, and its sign there."""
    new = re.sub(r"(FL|FR|RL|RR)", lambda leg: MIRRORED[leg[1]], name)
    new = re.sub(r"^s(\d+)$", lambda state: f"s{image[int(state[1])]}", new)
    return new, -1 if name.endswith("_hip") or name in ("cmd.yaw", "v.y") else 1
