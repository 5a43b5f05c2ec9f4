"""The base class of all policies, and the arrays in their files."""

import copy
import hashlib
import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import DTypeLike, NDArray

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError, shown
from glassgait.models.files import save_arrays
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import DEFAULT_LAW, DEFAULT_ROBOT, JointLaw, Robot
from glassgait.models.task.observation import (
    LARGEST_SOUND,
    ObservationLayout,
    machine_state_entries,
)

if TYPE_CHECKING:
    from glassgait.models.estimation.odometry import Odometry
    from glassgait.models.formulas.expression import Expression
    from glassgait.models.task.gait import Gait

FORMAT_VERSION = 1

LARGEST = 1e30
"""Greatest magnitude of a parameter, so that products of a few, as in networks, stay finite."""

INTERCEPT = "intercept"  # name of the constant term of a target


@dataclass(frozen=True)
class Reals:
    """An array of half, single or double precision, converted to double precision."""

    dims: str
    """Numbers, or names of sizes that arrays share: "joints trees nodes+1"; "pairs?" may be 0."""
    least: float = -LARGEST
    most: float = LARGEST
    ascending: bool = False

    def checked(self, array: NDArray[Any], sizes: Mapping[str, int]) -> NDArray[Any]:
        if array.dtype not in (np.float16, np.float32, np.float64):
            raise InputError(f"is of type {array.dtype}; it must be float16, float32 or float64")
        with np.errstate(invalid="ignore"):
            values = array.astype(np.float64, copy=False)
            inside = (values >= self.least) & (values <= self.most)
        if not inside.all():
            raise InputError(f"holds {values[~inside][0]:g}; give {self.least:g} to {self.most:g}")
        if self.ascending and not np.all(values[..., 1:] >= values[..., :-1]):
            raise InputError("does not ascend along its last axis")
        return values


@dataclass(frozen=True)
class Indices:
    """An array of indices that are less than the size named `of`."""

    dims: str
    of: str

    def checked(self, array: NDArray[Any], sizes: Mapping[str, int]) -> NDArray[Any]:
        if array.dtype.kind not in "iu" or not np.can_cast(array.dtype, np.int64):
            raise InputError(f"is of type {array.dtype}; it must be uint8, uint16, int32 or int64")
        inside = (array >= 0) & (array < sizes[self.of])
        if not inside.all():
            last = sizes[self.of] - 1
            raise InputError(f"holds {array[~inside][0]}; its numbers must be from 0 to {last}")
        return array


ArraySpec = Reals | Indices


def checked_arrays(
    arrays: Mapping[str, NDArray[Any]], specs: Mapping[str, ArraySpec], sizes: Mapping[str, int]
) -> dict[str, NDArray[Any]]:
    """Checks the arrays of a policy and returns them; `sizes` are those already known."""
    # Check the names.
    for name in sorted(set(arrays) ^ set(specs)):
        if name in specs:
            raise InputError(f"lacks the array {name!r}; make it again")
        raise InputError(f"has an unknown array {shown(name)}; make it again")

    # Check shapes and values; the first array with a named size decides it for the others.
    known, checked = dict(sizes), {}
    for name, spec in specs.items():
        try:
            _check_shape(np.shape(arrays[name]), spec.dims, known)
            checked[name] = spec.checked(np.asarray(arrays[name]), known)
        except InputError as error:
            raise InputError(f"array {name!r} {error}; make it again") from None
    return checked


def _check_shape(shape: tuple[int, ...], dims: str, sizes: dict[str, int]) -> None:
    """Checks a shape against `dims`, and adds the sizes of new names to `sizes`."""
    fits = len(shape) == len(dims.split())
    for size, dim in zip(shape, dims.split(), strict=False):
        name, _, extra = dim.rstrip("?").partition("+")
        base, least = size - int(extra or 0), 0 if dim.endswith("?") else 1
        known = int(name) if name.isdigit() else sizes.setdefault(name, max(base, least))
        fits = fits and base == known
    if not fits:
        known = ", ".join(f"{size} {name}" for name, size in sizes.items())
        raise InputError(
            f"is of shape {shown(shape)}; it must be ({', '.join(dims.split())}), with {known}"
        )


_NARROW = {"i": (np.uint8, np.int32), "f": (np.float16, np.float32)}


def narrowest(array: NDArray[Any]) -> NDArray[Any]:
    """Returns an array in the narrowest type that represents all its values exactly."""
    for width in _NARROW.get(array.dtype.kind, ()):
        if np.array_equal(rounded(array, width), array, equal_nan=True):
            return array.astype(width)
    return array


def rounded(array: NDArray[Any], width: DTypeLike) -> NDArray[Any]:
    """Rounds values to a narrower type, and returns them in the type of the array."""
    with np.errstate(over="ignore"):
        return array.astype(width).astype(array.dtype)


class FactoredTerm(NamedTuple):
    """A term of a joint's target: a weight times quantities, or a function of them."""

    weights: tuple[float, ...]
    """One weight for all RM states, or one per state; empty if the term is a function."""
    quantities: "tuple[Expression, ...]"
    state: int | None = None  # RM state whose formula has the term; None if all states share it


@dataclass(frozen=True)
class Contributions:
    """The names of the k terms that add up to a joint's targets, and their values (..., k; rad)."""

    terms: tuple[str, ...]
    values: Array


def contributions_of_action(
    robot: Robot, terms: Sequence[str], values: Array, joint: int
) -> Contributions:
    """Converts terms of a joint's actions (..., k), intercept first, to terms of its targets."""
    contributions = robot.action_scale * values
    contributions[..., 0] += robot.default_stance[joint]
    return Contributions(tuple(terms), contributions)


class Policy(ABC):
    """A callable `observation (..., n) -> action (..., 12)`, with the names of its observations.

    Policies are immutable, so that contexts and clones of a diagram can share one.
    """

    kind: ClassVar[str]
    suffix: ClassVar[str] = ".safetensors"
    array_specs: ClassVar[Mapping[str, ArraySpec]] = {}

    remembers: ClassVar[bool] = False
    """Whether the policy acts on a history of observations rather than on the latest one."""
    symmetric: ClassVar[bool] = True
    """Whether mirrored observations give mirrored actions, if the gait is symmetric."""

    joint_law: JointLaw = DEFAULT_LAW
    observes_by: str | None = None  # digest of the expert whose estimator the policy uses, if any
    machine: "Gait | None" = None  # the gait, if the policy's file contains it
    _estimator: "Callable[[Array], Array] | Odometry | None" = None

    def __init__(
        self,
        gait: str,
        observation_names: Sequence[str],
        *in_order: NDArray[Any],
        robot: Robot | None = None,
        **arrays: NDArray[Any],
    ) -> None:
        """Takes the arrays of `array_specs`, the first ones in order and the others by name."""
        if len(in_order) > len(self.array_specs):
            raise TypeError(f"{self.kind} policy: takes {len(self.array_specs)} arrays")
        arrays |= zip(self.array_specs, in_order, strict=False)
        with self._naming_this_kind():
            if not isinstance(gait, str) or not gait.isprintable() or not 0 < len(gait) <= 80:
                raise InputError(f"the gait is {shown(gait)}; it must be a name, so make it again")
            checked = checked_arrays(arrays, self.array_specs, self._sizes(observation_names))
        self.robot = robot or load_robot()
        self.gait = gait
        self.observation_names = tuple(observation_names)
        for name, array in checked.items():
            setattr(self, name, array)

    @classmethod
    def _sizes(cls, observation_names: Sequence[str]) -> dict[str, int]:
        """Checks the names of an observation, and returns the sizes that they decide."""
        names = tuple(observation_names)
        if not all(isinstance(name, str) for name in names):
            raise InputError("an observation's name is not text; make it again")
        layout = ObservationLayout.of(names)
        if names != layout.names:
            raise InputError("its observations are not those of the task; make it again")
        sizes = {"observations": len(names), "states": layout.n_machine_states}
        return {"joints": quadruped.N_JOINTS} | sizes

    @classmethod
    @contextmanager
    def _naming_this_kind(cls) -> Iterator[None]:
        try:
            yield
        except InputError as error:
            raise InputError(f"{cls.kind} policy: {error}") from error

    def __call__(self, observation: Array) -> Array:
        """Maps observations (..., n) to actions (..., 12).

        Returns NaN where an observation or action is not finite or exceeds `LARGEST_SOUND`. The
        joints then keep their targets, and the robot's failure is `not_finite`.
        """
        sound = (np.abs(observation) <= LARGEST_SOUND).all(axis=-1, keepdims=True)
        action = self.act(observation if sound.all() else np.where(sound, observation, 0.0))
        return np.where(sound & (np.abs(action) <= LARGEST_SOUND), action, np.nan)

    @abstractmethod
    def act(self, observation: Array) -> Array:
        """Maps finite observations (..., n) to actions (..., 12)."""

    @property
    def n_memory(self) -> int:
        """Length of the memory that the policy acts on."""
        return len(self.observation_names)

    @property
    def inputs(self) -> dict[str, list[int]]:
        """Columns of the memory by the names of what the policy observes."""
        return {name: [index] for index, name in enumerate(self.observation_names)}

    def remember(self, memory: Array, observation: Array) -> Array:
        """Returns the memory (..., n_memory) after an observation (..., n); the policy acts on it.

        It is NaN before an episode's first observation. By default it is the latest observation.
        """
        return observation

    @property
    def layout(self) -> ObservationLayout:
        return ObservationLayout.of(self.observation_names)

    @cached_property
    def _one_hot(self) -> slice:
        return machine_state_entries(self.observation_names)

    def machine_state(self, observation: Array) -> NDArray[np.intp]:
        """Returns the index of the RM state in observations (..., n)."""
        return np.argmax(observation[..., self._one_hot], axis=-1)

    def to_arrays(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Returns the named arrays and the JSON values that define this policy."""
        return {name: getattr(self, name) for name in self.array_specs}, {}

    @classmethod
    def from_arrays(
        cls, arrays: Mapping[str, NDArray[Any]], values: Mapping[str, Any], **names: Any
    ) -> Self:
        """Builds a policy from the result of `to_arrays`, its gait, observation names and robot."""
        arguments: dict[str, Any] = names | dict(arrays)
        return cls(**arguments)

    def with_arrays(self, **changed: NDArray[Any]) -> Self:
        """Returns the policy with some arrays changed, and without an expert's estimator."""
        arrays: dict[str, Any] = {name: getattr(self, name) for name in self.array_specs}
        arrays |= changed
        policy = type(self)(self.gait, self.observation_names, robot=self.robot, **arrays)
        return policy.with_joint_law(self.joint_law)

    def save(self, path: str | Path) -> None:
        arrays, values = self.to_arrays()
        header = {
            "format": FORMAT_VERSION,
            "kind": self.kind,
            "gait": self.gait,
            "observation_names": list(self.observation_names),
            "values": values,
        }
        if self.robot.name != DEFAULT_ROBOT:
            header["robot"] = self.robot.name
        if law := self.joint_law.to_plain():
            header["joint_law"] = law
        save_arrays(Path(path), {name: narrowest(array) for name, array in arrays.items()}, header)

    def compact(self) -> Self:
        """Returns the policy with its numbers rounded to take less space in a file."""
        return self

    def digest(self) -> str:
        """Returns a digest that differs between policies that act differently."""
        arrays, values = self.to_arrays()
        # Leave out defaults, so that policies older than a setting keep their digest.
        whole = hashlib.sha256(json.dumps([*self._named(), values]).encode())
        if law := self.joint_law.to_plain():
            whole.update(json.dumps(law).encode())
        for name in sorted(arrays):
            whole.update(name.encode() + np.ascontiguousarray(arrays[name]).tobytes())
        return whole.hexdigest()[:16]

    def _named(self) -> list[str]:
        robot = [] if self.robot.name == DEFAULT_ROBOT else [self.robot.name]
        return [self.kind, self.gait, *robot]

    @property
    def estimator(self) -> "Callable[[Array], Array] | Odometry | None":
        """Odometry, or a function from proprioception to the body state (..., 7), or None."""
        return self._estimator

    def with_estimator_of(self, expert: "Policy") -> Self:
        """Returns the policy with the estimator of its expert; files can store only odometry."""
        if expert.gait != self.gait:
            raise InputError(
                f"the expert's gait is {expert.gait} and the policy's {self.gait}; give another"
            )
        policy = copy.copy(self)
        policy.observes_by, policy._estimator = expert.digest(), expert.estimator
        return policy

    def with_joint_law(self, law: JointLaw) -> Self:
        """Returns the policy with another joint law, which must be valid for the robot."""
        law.check(self.robot)
        policy = copy.copy(self)
        policy.joint_law = law
        return policy

    def explain(self, observation: Array, joint: int | str) -> Contributions:
        """Splits a joint's targets at observations (..., n) into terms that add up to them."""
        raise InputError(f"policies of kind {self.kind!r} are not sums of terms; use another kind")

    def factored_terms(self, joint: int) -> tuple[FactoredTerm, ...]:
        """Returns the factors of the terms of a joint's targets, in the order of `explain`."""
        raise InputError(f"policies of kind {self.kind!r} are not sums of terms; use another kind")

    def importance(self, observations: Array) -> tuple[str, Array] | None:
        """Returns the name of a method and its importances (12, n) on samples (m, n), if any."""
        return None

    def refuse_other_machine(self, gait: "Gait") -> None:
        """Raises InputError if a gait differs from that in the file, or else from the shipped."""
        # Imported here, since few programs that load a policy need gaits.
        from glassgait.models.task.gait import gait_names, shipped_gait  # noqa: PLC0415

        made_for, remedy = self.machine, "give the policy's file as the gait, too"
        if made_for is None and self.gait in gait_names():
            made_for, remedy = shipped_gait(self.gait), "give a policy whose file has a 'machine'"
        if made_for is not None and (key := made_for.first_difference(gait)) is not None:
            raise InputError(
                f"this policy was made for another reward machine; this {gait.name} differs in "
                f"{key!r}; {remedy}"
            )

    def check(
        self, *, gait: "Gait | str", observation_names: tuple[str, ...], robot: Robot | None = None
    ) -> None:
        """Raises InputError unless the policy is for this gait (or name), observation and robot."""
        # Compare the names of robot and gait.
        name = gait if isinstance(gait, str) else gait.name
        made_for = "this policy was made for"
        if robot is not None and self.robot.name != robot.name:
            raise InputError(
                f"{made_for} robot {self.robot.name!r}, not {robot.name!r}; load one of that robot"
            )
        if self.gait != name:
            raise InputError(
                f"{made_for} gait {self.gait!r}, not {name!r}; give its gait, or another policy"
            )

        # Compare the reward machine and the observation layout.
        if not isinstance(gait, str):
            self.refuse_other_machine(gait)
        names = self.observation_names
        if names != observation_names:
            pairs = zip(names, observation_names, strict=False)
            first = next(
                (f"{a!r} instead of {b!r}" for a, b in pairs if a != b),
                f"{len(names)} entries instead of {len(observation_names)}",
            )
            raise InputError(f"this policy observes {first}; distil it again for this layout")
