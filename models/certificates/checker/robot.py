"""The robot and its quantities, read anew: the checker asks the prover for no number."""

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from .files import RefusedError, is_number, is_row, read_bytes, read_yaml, refuse_unless

LEGS, PARTS = ("FL", "FR", "RL", "RR"), ("hip", "thigh", "calf")
JOINTS = [f"{leg}_{part}" for leg in LEGS for part in PARTS]
MIRRORED = {"FL": "FR", "FR": "FL", "RL": "RR", "RR": "RL"}
TURNED = ("cmd.yaw", "v.y", "g.y", "w.x", "w.z")
"""Quantities that change their sign in the mirror, besides hips."""

COUNTED = ("t", "cmd.t")
ABRUPT = 60.0
"""Squared change of the action beyond which an episode ends."""

ANGLE_OVERRUN, OVERDUE = 0.06, 2
FASTEST_JOINT, FASTEST_TRUNK, FASTEST_TURN, STEEPEST = 50.0, 3.0, 20.0, 1.05
FOOT_HEIGHTS = (-0.1, 0.4)
"""Ends of the physical box: rad, control steps, rad/s, m/s, rad/s, no unit, m."""

DEFAULT_ROBOT = "a1"
NEEDED = {"name", "full_name", "description", "stance", "stiffness", "damping", "action_scale"}
Box = dict[str, tuple[float, float]]


def symbols(n_states: int, imu: bool = False) -> list[str]:
    """Names the quantities in the order of the observation, with those of an IMU or without."""
    of_joints = {kind: [f"{kind}.{joint}" for joint in JOINTS] for kind in ("q", "dq", "a")}
    trunk = [f"{kind}.{axis}" for kind in "gw" for axis in "xyz"] if imu else []
    states = [f"s{i}" for i in range(n_states)]
    measured = ["cmd.v", "cmd.yaw", *of_joints["q"], *of_joints["dq"], *trunk]
    estimated = ["v.x", "v.y", "v.z", *(f"h.{leg}" for leg in LEGS)]
    return [*measured, *of_joints["a"], *states, *COUNTED, *estimated]


def image_of(name: str, image: list[int]) -> tuple[str, int]:
    """Returns the mirror image of a quantity or a joint, and its sign there."""
    new = re.sub(r"(FL|FR|RL|RR)", lambda leg: MIRRORED[leg[1]], name)
    new = re.sub(r"^s(\d+)$", lambda state: f"s{image[int(state[1])]}", new)
    return new, -1 if name.endswith("_hip") or name in TURNED else 1


@dataclass(frozen=True)
class Robot:
    """The numbers that proofs take from a robot's file.

    Stance and limits are by joint in rad, efforts in N·m, the stiffness in N·m/rad. An action of 1
    adds the action scale to a joint's target (rad).
    """

    name: str
    stance: dict[str, float]
    limits: dict[str, tuple[float, float]]
    effort: dict[str, float]
    stiffness: float
    action_scale: float

    @classmethod
    def read(cls, path: Path) -> "Robot":
        """Reads a robot's file, and the joints' limits from the URDF that it names."""
        # Check the keys and their values.
        said = read_yaml(path)
        sound = isinstance(said, dict) and NEEDED <= {*said} <= NEEDED | {"motor_order", "joints"}
        refuse_unless(sound, f"{path} is no robot's file: it has other keys")
        refuse_unless(is_robot_name(said["name"]), f"{path}: its 'name' is none")
        for key in ("stiffness", "action_scale"):
            refuse_unless(is_number(said[key]) and said[key] > 0, f"{path}: its {key!r} is not > 0")
        stance = said["stance"]
        legs = isinstance(stance, dict) and {*stance} == {*LEGS}
        legs = legs and all(is_row(angles, len(PARTS)) for angles in stance.values())
        refuse_unless(legs, f"{path}: its 'stance' is not three angles of each leg")

        # The rest is the URDF's.
        angles = [float(angle) for leg in LEGS for angle in stance[leg]]
        joints = said.get("joints", {leg: [f"{leg}_{part}" for part in PARTS] for leg in LEGS})
        named = isinstance(joints, dict) and {*joints} == {*LEGS}
        named = named and all(isinstance(names, list) for names in joints.values())
        names = [name for leg in LEGS for name in joints[leg]] if named else []
        refuse_unless(len(names) == len(JOINTS), f"{path}: its 'joints' are not three of each leg")
        limits, effort = read_limits(path.parent / str(said["description"]), names)
        numbers = float(said["stiffness"]), float(said["action_scale"])
        return cls(said["name"], dict(zip(JOINTS, angles, strict=True)), limits, effort, *numbers)

    def offset(self, name: str) -> float:
        """Returns the value of a quantity that is observed as 0."""
        kind, _, joint = name.partition(".")
        return self.stance[joint] if kind in ("q", "a") else 0.0

    def physical(self, name: str, machine: dict[str, Any]) -> tuple[float, float]:
        """Returns the range of what a quantity can be, for the robots of a gait's machine."""
        shortest, longest = map(float, machine["dwell"])
        kind, _, rest = name.partition(".")
        low, high = self.limits.get(rest, (0.0, 0.0))
        speed = float(machine["max_speed" if rest == "v" else "max_yaw_rate"])
        ranges = {
            "cmd": (shortest, longest) if rest == "t" else (-speed, speed),
            "dq": (-FASTEST_JOINT, FASTEST_JOINT),
            "g": (-STEEPEST, STEEPEST),
            "w": (-FASTEST_TURN, FASTEST_TURN),
            "v": (-FASTEST_TRUNK, FASTEST_TRUNK),
            "q": _outward(low - ANGLE_OVERRUN, high + ANGLE_OVERRUN),
            "a": _outward(low, high),
            "t": (0.0, longest + OVERDUE),
            "h": FOOT_HEIGHTS,
        }
        return ranges.get(kind, (0.0, 1.0))


def is_robot_name(value: Any) -> bool:
    """Returns whether a value may be a robot's name, and so a folder's."""
    return isinstance(value, str) and bool(re.fullmatch(r"[a-z][a-z0-9_]{0,39}", value))


def read_limits(
    path: Path, names: list[str]
) -> tuple[dict[str, tuple[float, float]], dict[str, float]]:
    """Reads the joints' ranges (rad) and greatest torques (N·m) from a URDF, by its names."""
    try:
        root = ElementTree.fromstring(read_bytes(path))
    except ElementTree.ParseError as error:
        raise RefusedError(f"{path} is no URDF ({str(error)[:80]})") from error
    limits, effort = dict[str, tuple[float, float]](), dict[str, float]()
    ours = dict(zip(map(str, names), JOINTS, strict=True))
    for joint in root.iterfind("joint"):
        name = ours.get(joint.get("name", ""), "")
        for limit in joint.iterfind("limit"):
            ends = (float(limit.get(key, "nan")) for key in ("lower", "upper", "effort"))
            low, high, effort[name] = ends
            limits[name] = low, high
    for joint in JOINTS:
        low, high = limits.get(joint, (math.nan, math.nan))
        sound = -math.inf < low < high < math.inf and 0.0 < effort[joint] < math.inf
        refuse_unless(sound, f"{path}: limits of {joint} are not what they must be")
    return limits, effort


def _outward(low: float, high: float) -> tuple[float, float]:
    # Boxes have four decimals; a number that is off the last one by rounding only stays on it.
    return math.floor(round(low * 1e4, 6)) / 1e4, math.ceil(round(high * 1e4, 6)) / 1e4
