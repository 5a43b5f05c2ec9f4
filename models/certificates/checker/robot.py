"""The robot, read anew: a check that asked the prover for these numbers would check less.

All robots have the same legs and joints; what differs stands in `robot.yaml` and in the URDF beside
it. All files that are checked are read here: regular ones up to a size, which say everything once.
"""

import json
import math
import re
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import yaml

LEGS, PARTS = ("FL", "FR", "RL", "RR"), ("hip", "thigh", "calf")
JOINTS = [f"{leg}_{part}" for leg in LEGS for part in PARTS]
ABRUPT, ANGLE_OVERRUN, OVERDUE = 60.0, 0.06, 2
FASTEST_JOINT, FASTEST_TRUNK, FOOT_HEIGHTS = 50.0, 3.0, (-0.1, 0.4)
FASTEST_TURN, STEEPEST = 20.0, 1.05
MIRRORED = {"FL": "FR", "FR": "FL", "RL": "RR", "RR": "RL"}
COUNTED = ("t", "cmd.t")
TURNED = ("cmd.yaw", "v.y", "g.y", "w.x", "w.z")
"""What has another sign in the mirror, besides hips."""

DEFAULT_ROBOT = "a1"
"""The robot of files that name none."""

NEEDED = {"name", "full_name", "description", "stance", "stiffness", "damping", "action_scale"}
ALLOWED = NEEDED | {"motor_order"}
"""Keys of a robot's file; no file has others."""

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


def symbols(n_states: int, imu: bool = False) -> list[str]:
    """Names the quantities in the order of the observation, with those of an IMU or without."""
    measured, last_targets = (
        [f"{kind}.{joint}" for kind in kinds for joint in JOINTS] for kinds in (("q", "dq"), "a")
    )
    trunk = [f"{kind}.{axis}" for kind in "gw" for axis in "xyz"] if imu else []
    last = ["t", "cmd.t", "v.x", "v.y", "v.z", *(f"h.{leg}" for leg in LEGS)]
    states = [f"s{i}" for i in range(n_states)]
    return ["cmd.v", "cmd.yaw", *measured, *trunk, *last_targets, *states, *last]


def image_of(name: str, image: list[int]) -> tuple[str, int]:
    """Returns what a quantity or a joint is in the mirror, and its sign there."""
    new = re.sub(r"(FL|FR|RL|RR)", lambda leg: MIRRORED[leg[1]], name)
    new = re.sub(r"^s(\d+)$", lambda state: f"s{image[int(state[1])]}", new)
    return new, -1 if name.endswith("_hip") or name in TURNED else 1


@dataclass(frozen=True)
class Robot:
    """What proofs take from a robot's file.

    Attributes:
        name: Its name.
        stance: Angles of the default stance by joint (rad).
        limits: Least and greatest angle by joint (rad).
        effort: Greatest torque by joint (N·m).
        stiffness: Gain of the joints' position control (N·m/rad).
        action_scale: What an action of 1 adds to a joint's target (rad).
    """

    name: str
    stance: dict[str, float]
    limits: dict[str, tuple[float, float]]
    effort: dict[str, float]
    stiffness: float
    action_scale: float

    @classmethod
    def read(cls, path: Path) -> "Robot":
        """Reads a robot's file and the limits in its URDF.

        Raises:
            RefusedError: if it has other keys than such a file, or a value of another kind.
        """
        said = read_yaml(path)
        sound = isinstance(said, dict) and NEEDED <= {*said} <= ALLOWED
        refuse_unless(sound, f"{path} is no robot's file: it has other keys")
        refuse_unless(is_robot_name(said["name"]), f"{path}: its 'name' is none")
        for key in ("stiffness", "action_scale"):
            refuse_unless(is_positive(said[key]), f"{path}: its {key!r} is not above 0")
        stance = said["stance"]
        legs = isinstance(stance, dict) and {*stance} == {*LEGS}
        legs = legs and all(is_row(angles, len(PARTS)) for angles in stance.values())
        refuse_unless(legs, f"{path}: its 'stance' is not three angles of each leg")
        limits, effort = read_limits(path.parent / str(said["description"]))
        return cls(
            said["name"],
            dict(zip(JOINTS, [float(own) for leg in LEGS for own in stance[leg]], strict=True)),
            limits,
            effort,
            float(said["stiffness"]),
            float(said["action_scale"]),
        )

    def units(self, name: str) -> tuple[float, float]:
        """Returns scale and offset of a quantity, observed as (quantity - offset) * scale."""
        kind, _, joint = name.partition(".")
        scales = {"dq": 0.05, "a": 1.0 / self.action_scale, "t": 0.1, "v": 2.0, "w": 0.25}
        scale = 0.1 if name == "cmd.t" else scales.get(kind, 1.0)
        return scale, self.stance[joint] if kind in ("q", "a") else 0.0


def read_limits(path: Path) -> tuple[dict[str, tuple[float, float]], dict[str, float]]:
    """Reads the joints' ranges (rad) and greatest torques (N·m) from a URDF."""
    keys = ("lower", "upper", "effort")
    try:
        root = ElementTree.fromstring(read_bytes(path, MOST_BYTES // 10))
        limits = {
            joint.get("name"): [float(limit.get(key, "nan")) for key in keys]
            for joint in root.iterfind("joint")
            for limit in joint.iterfind("limit")
        }
    except (ElementTree.ParseError, ValueError) as error:
        raise RefusedError(f"{path} is no URDF ({str(error)[:80]})") from error
    for joint in JOINTS:
        low, high, effort = limits.get(joint, [math.nan] * 3)
        refuse_unless(
            low < high and math.isfinite(high - low) and is_positive(effort),
            f"{path}: limits of {joint} are not what they must be",
        )
    return (
        {joint: (limits[joint][0], limits[joint][1]) for joint in JOINTS},
        {joint: limits[joint][2] for joint in JOINTS},
    )


def is_robot_name(value: Any) -> bool:
    """Returns whether a value may be a robot's name, and so a folder's."""
    return isinstance(value, str) and bool(re.fullmatch(r"[a-z][a-z0-9_]{0,39}", value))


def is_number(value: Any) -> bool:
    """Returns whether a value is a finite number, and no truth value."""
    return type(value) in (int, float) and abs(value) <= 1e300 and math.isfinite(value)


def is_positive(value: Any) -> bool:
    return is_number(value) and value > 0


def stiffness_of(gains: Any) -> float:
    """Returns the first of a policy's gains, which are a stiffness and a damping.

    Raises:
        RefusedError: if they are not, or out of the ranges that robots take.
    """
    sound = is_row(gains, 2) and 0.0 < gains[0] <= 1000.0 and 0.0 <= gains[1] <= 100.0
    refuse_unless(sound, "the policy's gains are no stiffness and damping of joints")
    return float(gains[0])


def is_row(value: Any, count: int) -> bool:
    return isinstance(value, list) and len(value) == count and all(map(is_number, value))


MOST_BYTES = 100_000_000
"""Greatest size of a certificate or a policy; a gait's file is a thousandth of it at most."""


def read_bytes(path: Path, most: int = MOST_BYTES) -> bytes:
    """Reads a file; a device or a pipe, which may never end, is refused.

    Raises:
        RefusedError: if it is none, is larger, or cannot be read.
    """
    try:
        refuse_unless(stat.S_ISREG(path.stat().st_mode), f"{path} is no regular file")
        with path.open("rb") as stream:
            data = stream.read(most + 1)
    except (OSError, ValueError) as error:
        raise RefusedError(f"{path} cannot be read ({error})") from error
    refuse_unless(len(data) <= most, f"{path} is larger than {most} bytes")
    return data


def read_json(data: bytes) -> Any:
    """Reads JSON, without keys that are given twice and without numbers that are none."""
    return json.loads(data.decode("ascii"), object_pairs_hook=_once, parse_constant=_refused)


def read_yaml(path: Path) -> Any:
    """Reads a file of plain values."""
    return parse_yaml(read_bytes(path, MOST_BYTES // 1000), path)


def parse_yaml(data: bytes, source: object) -> Any:
    """Reads plain values. Aliases, by which a few bytes unfold to gigabytes, are refused."""
    try:
        depth = 0
        for event in yaml.parse(data):
            named = getattr(event, "anchor", None) or getattr(event, "tag", None)
            refuse_unless(not named, f"{source} holds anchors, aliases or tags")
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            refuse_unless(depth <= DEEPEST, f"{source} is nested too deep")
        return yaml.load(data, _Strict)
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        raise RefusedError(f"{source} is no YAML ({str(error)[:80]})") from error


DEEPEST, LONGEST_NUMBER = 20, 100
"""Greatest nesting of values in YAML, and greatest number of characters of a number."""


class _Strict(yaml.SafeLoader):
    """Plain values, each key once: of two the last would count, and a reader sees the first.

    What is no number, truth value or nothing is text, a date as well.
    """

    yaml_implicit_resolvers = {  # noqa: RUF012
        first: [
            own for own in resolvers if own[0].rsplit(":", 1)[1] in ("null", "bool", "int", "float")
        ]
        for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }

    def construct_scalar(self, node: yaml.ScalarNode) -> Any:
        is_text = node.tag == "tag:yaml.org,2002:str"
        refuse_unless(is_text or len(node.value) <= LONGEST_NUMBER, "a number is too long")
        return super().construct_scalar(node)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]
        refuse_unless(all(isinstance(key, str) for key in keys), "a key is no text")
        refuse_unless(len(keys) == len({*keys}), "a key is given twice")
        return super().construct_mapping(node, deep)


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    whole = dict(pairs)
    refuse_unless(len(whole) == len(pairs), "a key is given twice")
    return whole


def _refused(text: str) -> None:
    raise RefusedError(f"{text} is no number")
