"""Policies of other projects: a network and its description, a YAML file.

The description lists what the network observes, in order, and says what its actions mean. At each
control step, the policy converts this project's observation to a *frame*, the network's observation
of one step. It passes the latest frames to the network and converts its output to an action.
"""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import asdict
from functools import cached_property
from importlib.util import find_spec
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar, get_args

import numpy as np
from annotated_types import Ge, Le, MaxLen, MinLen
from numpy.typing import NDArray

from glassgait.models import BASE_VELOCITY_SCALE
from glassgait.models.arrays import Array
from glassgait.models.errors import InputError, brief, shown, unknown_name
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.files import read_bytes, read_yaml, resolve_paths
from glassgait.models.policies.checkpoint import network_of_checkpoint
from glassgait.models.policies.library import naming
from glassgait.models.policies.policy import ArraySpec, Indices, Policy
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.quadruped import JOINTS, N_JOINTS
from glassgait.models.robots.robot import Angle, JointDamping, JointLaw, JointStiffness
from glassgait.models.settings import FEW, Positive, Range, Settings, checked
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import FREE, Gait, shipped_gait
from glassgait.models.task.observation import (
    ANGULAR_VELOCITY_SCALE,
    JOINT_VELOCITY_SCALE,
    LARGEST_SOUND,
    Group,
    ObservationLayout,
    indices_of,
)

WEIGHT_BYTES = 100_000_000  # largest allowed weights file

XYZ = ("x", "y", "z")
TERMS: dict[str, tuple[str, ...]] = {
    "angular_velocity": XYZ,  # rad/s, in the trunk's frame
    "gravity": XYZ,  # unit vector in the trunk's frame, (0, 0, -1) if level
    "command": ("forward", "left", "yaw"),  # m/s, m/s, rad/s
    "joint_position": JOINTS,  # rad, minus the default
    "joint_velocity": JOINTS,  # rad/s
    "last_action": JOINTS,  # the network's previous output
    "base_velocity": XYZ,  # m/s in the trunk's frame, by odometry
    "clock": ("sine", "cosine"),
    "constant": (),  # one entry per value
}
"""Names of the entries of each term of a frame; joints are in the network's order."""

Number = Annotated[float, Ge(-1e6), Le(1e6)]  # what single precision holds
LEAST_SCALE = 1e-6  # least magnitude of the scale of an action (rad)

T = TypeVar("T")
PerJoint = T | Annotated[dict[str, T], MaxLen(N_JOINTS)]
"""A number for all joints, or numbers by kind of joint (hip, thigh, calf) or by joint (FL_hip)."""


@checked
class Term(Settings):
    """A part of a frame."""

    title: ClassVar[str] = "observation term"

    term: str  # one of `TERMS`
    scale: Number | Annotated[tuple[Number, ...], FEW] = 1.0  # one factor, or one per entry
    period: Annotated[float, Ge(CONTROL_PERIOD)] | None = None  # the clock's period (s)
    values: Annotated[tuple[Number, ...], FEW] = ()  # the constant's values
    clip: Range | None = None  # range of the entries before they are scaled

    def __post_init__(self) -> None:
        if "height" in self.term or "scan" in self.term:
            raise InputError(
                f"term {shown(self.term)} is a scan of the ground; give a blind policy, since no "
                "robot here measures the ground"
            )
        if self.term not in TERMS:
            raise unknown_name("observation term", self.term, TERMS)
        for key, term in (("period", "clock"), ("values", "constant")):
            if bool(getattr(self, key)) != (self.term == term):
                raise InputError(
                    f"key {key!r} belongs to the term {term!r}; give it there, and only there"
                )
        if isinstance(self.scale, tuple) and len(self.scale) != self.size:
            raise InputError(
                f"scale of the term {self.term!r} has {len(self.scale)} numbers; give one, or "
                f"{self.size}"
            )

    @property
    def size(self) -> int:
        """Number of the term's entries."""
        return len(TERMS[self.term]) or len(self.values)


@checked
class History(Settings):
    """The latest frames, which a network observes together."""

    length: Annotated[int, Ge(1), Le(100)] = 1  # number of frames, the present one included
    order: Literal["oldest_first", "newest_first"] = "oldest_first"
    # All terms of one frame after another, or all frames of one term after another.
    by: Literal["frame", "term"] = "frame"
    start: Literal["zeros", "repeat"] = "repeat"  # missing frames: 0, or the first frame


@checked
class Clip(Settings):
    """Largest magnitudes of scaled entries and of the network's outputs; by default unlimited."""

    observation: Positive | None = None
    action: Positive | None = None


@checked
class DescribedGains(Settings):
    """Gains of the joints' position and velocity control."""

    stiffness: PerJoint[JointStiffness]  # N·m/rad
    damping: PerJoint[JointDamping]  # N·m·s/rad


@checked
class Commands(Settings):
    """Ranges to which commands are clipped before the network observes them (m/s, m/s, rad/s)."""

    forward: Range = (-1.0, 1.0)
    left: Range = (0.0, 0.0)
    yaw: Range = (-1.0, 1.0)


@checked
class Description(Settings):
    """A network's inputs and outputs; `models/policies/README.md` explains the file."""

    title: ClassVar[str] = "description"

    robot: str
    # An ONNX file, or an rsl_rl checkpoint (.pt), relative to the description's folder.
    weights: str
    observation: Annotated[tuple[Term, ...], MinLen(1), FEW]  # one frame, in order
    default: PerJoint[Angle]  # angles at an output of 0 (rad)
    action_scale: PerJoint[Number]  # change of the target per unit of output (rad)
    gains: DescribedGains
    joints: tuple[str, ...] = JOINTS  # order of joints in observations and outputs
    period: Positive = CONTROL_PERIOD  # s
    history: History = History()
    clip: Clip = Clip()
    activation: Literal["elu", "selu", "relu", "tanh"] = "elu"  # between layers of a checkpoint
    commands: Commands = Commands()

    def __post_init__(self) -> None:
        if find_spec("onnx") is None or find_spec("onnxruntime") is None:
            raise InputError("ONNX is not installed; run pip install 'glassgait[onnx]'")
        if sorted(self.joints) != sorted(JOINTS):
            raise InputError(
                f"joints is {shown(self.joints)}; list these, in the network's order: "
                f"{', '.join(JOINTS)}"
            )
        if abs(self.period - CONTROL_PERIOD) > 1e-9:
            raise InputError(
                f"period is {self.period:g} s; give a network for {CONTROL_PERIOD} s, the period "
                "of this project's control step"
            )
        for key in ("default", "action_scale", "gains.stiffness", "gains.damping"):
            self.by_joint(key)
        if np.abs(self.by_joint("action_scale")).min() < LEAST_SCALE:
            raise InputError("action_scale is 0 for a joint; give other numbers")

    @property
    def frame_size(self) -> int:
        """Number of entries of one frame."""
        return sum(term.size for term in self.observation)

    @property
    def input_size(self) -> int:
        """Number of entries of the network's input."""
        return self.history.length * self.frame_size

    @property
    def joint_law(self) -> JointLaw:
        """The joint law with these gains; a gain is one number if all joints share it."""
        gains = (self.by_joint(f"gains.{key}").tolist() for key in ("stiffness", "damping"))
        stiffness, damping = (tuple(gain) if len({*gain}) > 1 else gain[0] for gain in gains)
        return JointLaw((stiffness, damping))

    def by_joint(self, key: str) -> Array:
        """Returns the values of a key, such as `default`, by joint (12; order of `JOINTS`)."""
        given = attrgetter(key)(self)
        if not isinstance(given, dict):
            return np.full(N_JOINTS, given)
        kinds = [joint.partition("_")[2] for joint in JOINTS]
        for name in given:
            if name not in (*kinds, *JOINTS):
                raise InputError(f"key {f'{key}.{name}'!r} names no joint; name hip or FL_hip")
        pairs = zip(JOINTS, kinds, strict=True)
        values = [given.get(joint, given.get(kind)) for joint, kind in pairs]
        if None in values:
            raise InputError(f"{key} lacks {JOINTS[values.index(None)]}; add it")
        return np.array(values, dtype=float)


class DescribedPolicy(Policy):
    """A network of another project, with its description.

    It reads the IMU, the joints, its previous action and, for `base_velocity`, odometry. Its memory
    (see `Policy.remember`) holds the number of past control steps and the frames, oldest first.
    """

    kind = "described"
    remembers, symmetric = True, False
    array_specs: ClassVar[Mapping[str, ArraySpec]] = {"weights": Indices("bytes", of="values")}
    weights: NDArray[np.uint8]
    """The bytes of the ONNX file."""

    def __init__(self, *arguments: Any, description: Description, **named: Any) -> None:
        """Takes the arguments of a `Policy` and the network's description."""
        super().__init__(*arguments, **named)
        self.description, self._estimator = description, Odometry()
        self._left: float | Array = 0.0
        self.joint_law = description.joint_law
        self._order = np.array([JOINTS.index(joint) for joint in description.joints])
        self._default = description.by_joint("default")
        self._scale = description.by_joint("action_scale")
        # Indices of this project's observation, by quantity.
        groups = get_args(Group)
        self._entries = {name: [*indices_of(name, self.observation_names)] for name in groups}
        self._check_network()

    @classmethod
    def _sizes(cls, observation_names: Sequence[str]) -> dict[str, int]:
        return super()._sizes(observation_names) | {"values": 256}

    def to_arrays(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        arrays, values = super().to_arrays()
        return arrays, values | {"description": asdict(self.description)}

    @classmethod
    def from_arrays(
        cls, arrays: Mapping[str, NDArray[Any]], values: Mapping[str, Any], **names: Any
    ) -> "DescribedPolicy":
        description = Description.from_plain(values.get("description"), "key 'description'")
        return super().from_arrays(arrays, values, description=description, **names)

    def with_description(self, description: Description) -> "DescribedPolicy":
        """Returns the same network with another description."""
        names = self.observation_names
        return type(self)(self.gait, names, self.weights, robot=self.robot, description=description)

    def commanded_left(self, speed: float | Array) -> Self:
        """Returns the policy with a commanded speed to the left (m/s), a number or one per robot.

        The speed is clipped to `commands.left`, as commands of the other directions are.
        """
        policy = copy(self)
        policy._left = speed
        return policy

    @property
    def n_memory(self) -> int:
        return 1 + self.description.input_size

    @property
    def inputs(self) -> dict[str, list[int]]:
        names = []
        for term in self.description.observation:
            parts = TERMS[term.term] or range(term.size)
            parts = self.description.joints if parts == JOINTS else parts
            names += [f"{term.term} {part}" for part in parts]
        columns = np.arange(1, self.n_memory).reshape(self.description.history.length, -1)
        return dict(zip(names, columns.T.tolist(), strict=True))

    def remember(self, memory: Array, observation: Array) -> Array:
        begins = np.isnan(memory[..., :1])
        count = np.where(begins, 0.0, memory[..., :1] + 1.0)
        frame = self._frame(observation, begins, count)

        # Drop the oldest frame and append the new one.
        start = np.zeros_like(frame) if self.description.history.start == "zeros" else frame
        n_older = self.description.history.length - 1
        older = np.where(begins, np.tile(start, n_older), memory[..., 1 + frame.shape[-1] :])
        after = np.concatenate([count, older, frame], axis=-1)

        # Begin again after an entry that is not finite or too large.
        sound = (np.abs(observation) <= LARGEST_SOUND).all(axis=-1, keepdims=True)
        return np.where(sound, after, np.nan)

    def _frame(self, observation: Array, begins: NDArray[np.bool_], count: Array) -> Array:
        """Returns the network's frames (..., frame_size) of observations (..., n)."""
        observed = {name: observation[..., index] for name, index in self._entries.items()}
        robot, commands = self.robot, self.description.commands
        forward, yaw = np.split(observed["commanded velocity"], 2, axis=-1)
        left = np.zeros_like(forward) + np.expand_dims(self._left, -1)
        command = np.concatenate([forward, left, yaw], axis=-1)
        ranges = np.array([commands.forward, commands.left, commands.yaw])
        position = observed["joint position"] + robot.default_stance
        target = robot.joint_targets(observed["previous action"])
        action = np.where(begins, 0.0, (target - self._default) / self._scale)
        quantities = {
            "angular_velocity": observed["angular velocity"] / ANGULAR_VELOCITY_SCALE,
            "gravity": observed["gravity"],
            "command": np.clip(command, *ranges.T),
            "joint_position": (position - self._default)[..., self._order],
            "joint_velocity": observed["joint velocity"][..., self._order] / JOINT_VELOCITY_SCALE,
            "last_action": action[..., self._order],
            "base_velocity": observed["base velocity"] / BASE_VELOCITY_SCALE,
        }
        parts = []
        for term in self.description.observation:
            if term.term == "constant":
                values = np.broadcast_to(term.values, (*count.shape[:-1], term.size))
            elif term.period:
                phase = 2.0 * np.pi * CONTROL_PERIOD / term.period * count
                values = np.concatenate([np.sin(phase), np.cos(phase)], axis=-1)
            else:
                values = quantities[term.term]
            clipped = values if term.clip is None else np.clip(values, *term.clip)
            parts.append(clipped * np.asarray(term.scale))
        frame = np.concatenate(parts, axis=-1)
        limit = self.description.clip.observation
        return frame if limit is None else np.clip(frame, -limit, limit)

    def act(self, observation: Array) -> Array:
        """Maps memories (..., n_memory) to actions (..., 12)."""
        answer = self._network(observation[..., self._input_order]).astype(float)
        limit = self.description.clip.action
        answer = answer if limit is None else np.clip(answer, -limit, limit)
        action = np.empty_like(answer)
        action[..., self._order] = answer
        target = self._default + self._scale * action
        return (target - self.robot.default_stance) / self.robot.action_scale

    @cached_property
    def _input_order(self) -> NDArray[np.intp]:
        """Indices of the network's inputs in its memory."""
        history, sizes = self.description.history, [t.size for t in self.description.observation]
        order = np.arange(1, self.n_memory).reshape(history.length, -1)
        order = order[::-1] if history.order == "newest_first" else order
        parts = np.split(order, np.cumsum(sizes)[:-1], axis=1) if history.by == "term" else [order]
        return np.concatenate([part.ravel() for part in parts])

    def _network(self, seen: Array) -> Array:
        (given,) = self._session.get_inputs()
        dtype = float if given.type == "tensor(double)" else np.float32
        rows = seen.reshape(-1, seen.shape[-1]).astype(dtype)
        # Many exported networks take exactly one row.
        parts = np.split(rows, len(rows)) if isinstance(given.shape[0], int) else [rows]
        answers = [self._session.run(None, {given.name: part})[0] for part in parts]
        return np.concatenate(answers).reshape(*seen.shape[:-1], N_JOINTS)

    @cached_property
    def _session(self) -> Any:
        import onnxruntime  # noqa: PLC0415

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 4  # its errors are raised, too
        return onnxruntime.InferenceSession(self.weights.tobytes(), options)

    def _check_network(self) -> None:
        """Refuses a network that cannot act, has non-finite weights or the wrong size."""
        import onnx  # noqa: PLC0415

        # Read the network.
        name, size = self.description.weights, self.description.input_size
        try:
            network, session = onnx.load_from_string(self.weights.tobytes()), self._session
        except Exception as error:
            problem = brief(str(error))
            raise InputError(f"{name} is no ONNX network ({problem}); export it") from error
        for weight in network.graph.initializer:
            values = onnx.numpy_helper.to_array(weight)
            if values.dtype.kind == "f" and not np.isfinite(values).all():
                raise InputError(f"{name}: {weight.name!r} is not finite; export the network again")

        # Compare its size, and let it act once.
        *_, width = [None, *session.get_inputs()[0].shape]
        if isinstance(width, int) and width != size:
            frames = f"{self.description.history.length} × {self.description.frame_size}"
            raise InputError(
                f"{name} takes {width} numbers, but history and observation are {frames}; correct "
                "one of them"
            )
        try:
            answer = self._network(np.zeros((2, size)))
        except Exception as error:
            raise InputError(
                f"{name} cannot act ({brief(str(error))}); give a network from one array "
                f"(robots, {size}) to actions (robots, {N_JOINTS})"
            ) from error
        if not np.isfinite(answer).all():
            raise InputError(f"{name} acts by numbers that are not finite; export it again")

    def __getstate__(self) -> dict[str, Any]:
        # A session cannot be pickled; another process opens the network again.
        return {name: value for name, value in vars(self).items() if name != "_session"}


def load_described(path: str | Path, gait: Gait | None = None) -> DescribedPolicy:
    """Loads a description and its network for a gait, by default `free`."""
    path = Path(path)
    return described(resolve_paths(path, read_yaml(path)), path, gait)


def described(plain: Any, path: Path, gait: Gait | None = None) -> DescribedPolicy:
    """Builds a policy from a description's values; weights are relative to the folder of `path`."""
    gait = shipped_gait(FREE) if gait is None else gait
    with naming(path):
        description = Description.from_plain(plain)
        weights = path.parent / description.weights
        network = read_bytes(weights, WEIGHT_BYTES)
        if weights.suffix != ".onnx":
            network = network_of_checkpoint(
                network,
                name=weights.name,
                activation=description.activation.title(),
                size=description.input_size,
            )
        names = ObservationLayout(gait.n_states, imu=True).names
        data, robot = np.frombuffer(network, dtype=np.uint8), load_robot(description.robot)
        return DescribedPolicy(gait.name, names, data, robot=robot, description=description)
