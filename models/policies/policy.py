"""The base of all policies, and the files that hold them."""

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
"""Greatest size of a parameter: products of a few, as in a network, stay finite."""

INTERCEPT = "intercept"
"""The constant among the terms of a target."""


@dataclass(frozen=True)
class Reals:
    """An array of half, single or double precision, converted to double precision."""

    dims: str
    """Numbers, or names of one size in all arrays: "joints trees nodes+1"; "n?" may be 0."""
    least: float = -LARGEST
    most: float = LARGEST
    ascending: bool = False

    def taken(self, array: NDArray[Any], sizes: Mapping[str, int]) -> NDArray[Any]:
        if array.dtype not in (np.float16, np.float32, np.float64):
            raise InputError(f"is of type {array.dtype}; it must be float16, float32 or float64")
        with np.errstate(invalid="ignore"):
            values = array.astype(np.float64, copy=False)
            inside = (values >= self.least) & (values <= self.most)
        if not inside.all():
            raise InputError(
                f"holds {values[~inside][0]:g}; its numbers must be from {self.least:g} to "
                f"{self.most:g}"
            )
        if self.ascending and not np.all(values[..., 1:] >= values[..., :-1]):
            raise InputError("does not ascend; it must along its last axis")
        return values


@dataclass(frozen=True)
class Indices:
    """An array of indices that stay below the size of the name `of`."""

    dims: str
    of: str

    def taken(self, array: NDArray[Any], sizes: Mapping[str, int]) -> NDArray[Any]:
        if array.dtype.kind not in "iu" or not np.can_cast(array.dtype, np.int64):
            raise InputError(f"is of type {array.dtype}; it must be uint8, uint16, int32 or int64")
        inside = (array >= 0) & (array < sizes[self.of])
        if not inside.all():
            last = sizes[self.of] - 1
            raise InputError(f"holds {array[~inside][0]}; its numbers must be from 0 to {last}")
        return array


ArraySpec = Reals | Indices


def take_arrays(
    arrays: Mapping[str, NDArray[Any]], specs: Mapping[str, ArraySpec], sizes: Mapping[str, int]
) -> dict[str, NDArray[Any]]:
    """Checks the arrays of a policy and returns them; `sizes` are those known so far."""
    # The names.
    for name in sorted(set(arrays) ^ set(specs)):
        if name in specs:
            raise InputError(f"lacks the array {name!r}; make it anew")
        raise InputError(f"holds an array {shown(name)}, which is no part of it; make it anew")

    # Sizes that the first arrays have are those that the others must have.
    known, taken = dict(sizes), {}
    for name, spec in specs.items():
        try:
            _fit_shape(np.shape(arrays[name]), spec.dims, known)
            taken[name] = spec.taken(np.asarray(arrays[name]), known)
        except InputError as error:
            raise InputError(f"array {name!r} {error}; make it anew") from None
    return taken


def _fit_shape(shape: tuple[int, ...], dims: str, sizes: dict[str, int]) -> None:
    """Refuses a shape of other dimensions, and notes the sizes of names that are new."""
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
    """Returns an array in the narrowest type that holds all its values exactly."""
    for width in _NARROW.get(array.dtype.kind, ()):
        if np.array_equal(rounded(array, width), array, equal_nan=True):
            return array.astype(width)
    return array


def rounded(array: NDArray[Any], width: DTypeLike) -> NDArray[Any]:
    """Returns an array of the same type, with its values rounded to a narrower one."""
    with np.errstate(over="ignore"):
        return array.astype(width).astype(array.dtype)


class FactoredTerm(NamedTuple):
    """A term of a joint's target: a weight times quantities, or a function of them."""

    weights: tuple[float, ...]
    """The weight, one for all RM states or one each; empty where the term is a function."""
    quantities: "tuple[Expression, ...]"
    state: int | None = None
    """RM state whose formula the term is part of; None where it serves all."""


@dataclass(frozen=True)
class Contributions:
    """The parts that add up to a joint's targets: k names, and contributions (..., k; rad)."""

    terms: tuple[str, ...]
    values: Array


def contributions_of_action(
    robot: Robot, terms: Sequence[str], values: Array, joint: int
) -> Contributions:
    """Turns parts of a joint's actions (..., k), the intercept first, into parts of its targets."""
    of_target = robot.action_scale * values
    of_target[..., 0] += robot.default_stance[joint]
    return Contributions(tuple(terms), of_target)


class Policy(ABC):
    """A callable `observation (..., n) -> action (..., 12)` that names what it observes.

    Policies are immutable: a systems diagram may share one between contexts and clones.
    """

    kind: ClassVar[str]
    suffix: ClassVar[str] = ".safetensors"
    array_specs: ClassVar[Mapping[str, ArraySpec]] = {}

    joint_law: JointLaw = DEFAULT_LAW
    observes_by: str | None = None
    """Digest of the expert whose estimator it observes by, if it has one from there."""
    machine: "Gait | None" = None
    """The gait itself, where the policy's file holds it."""
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
                raise InputError(f"the gait is {shown(gait)}; it must be a name, so make it anew")
            taken = take_arrays(arrays, self.array_specs, self._sizes(observation_names))
        self.robot = robot or load_robot()
        self.gait = gait
        self.observation_names = tuple(observation_names)
        for name, array in taken.items():
            setattr(self, name, array)

    @classmethod
    def _sizes(cls, observation_names: Sequence[str]) -> dict[str, int]:
        """Returns the sizes that are known, and refuses names of another observation."""
        names = tuple(observation_names)
        if not all(isinstance(name, str) for name in names):
            raise InputError("an observation's name is not text; make it anew")
        layout = ObservationLayout.of(names)
        if names != layout.names:
            raise InputError("its observations are not those of the task; make it anew")
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

        The answer is NaN where an observation or an action is not finite or beyond `LARGEST_SOUND`.
        The joints then keep their targets, and the robot shows the failure `not_finite`.
        """
        sound = (np.abs(observation) <= LARGEST_SOUND).all(axis=-1, keepdims=True)
        action = self.act(observation if sound.all() else np.where(sound, observation, 0.0))
        return np.where(sound & (np.abs(action) <= LARGEST_SOUND), action, np.nan)

    @abstractmethod
    def act(self, observation: Array) -> Array:
        """Maps finite observations (..., n) to actions (..., 12)."""

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
        """Returns named arrays, and values that JSON can hold, that define this policy."""
        return {name: getattr(self, name) for name in self.array_specs}, {}

    @classmethod
    def from_arrays(
        cls, arrays: Mapping[str, NDArray[Any]], values: Mapping[str, Any], **names: Any
    ) -> Self:
        """Rebuilds the policy that `to_arrays` took apart, with its gait, observation and robot."""
        parts: dict[str, Any] = names | dict(arrays)
        return cls(**parts)

    def with_arrays(self, **changed: NDArray[Any]) -> Self:
        """Returns the policy with some arrays changed, and without an expert's estimator."""
        arrays: dict[str, Any] = {name: getattr(self, name) for name in self.array_specs}
        arrays |= changed
        made = type(self)(self.gait, self.observation_names, robot=self.robot, **arrays)
        return made.with_joint_law(self.joint_law)

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
        """Returns the policy with numbers that take less space in a file, where that helps."""
        return self

    def digest(self) -> str:
        """Returns a digest that differs between policies that act differently."""
        arrays, values = self.to_arrays()
        # What every file has by default is left out, so that old digests stay.
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
        """Odometry, or the map from proprioception to the body state (..., 7), or None."""
        return self._estimator

    def with_estimator_of(self, expert: "Policy") -> Self:
        """Returns the policy with the estimator of its expert; files hold only odometry."""
        if expert.gait != self.gait:
            raise InputError(
                f"the expert is of the {expert.gait} and the policy of the {self.gait}; name the "
                f"expert of the {self.gait}"
            )
        made = copy.copy(self)
        made.observes_by, made._estimator = expert.digest(), expert.estimator
        return made

    def with_joint_law(self, law: JointLaw) -> Self:
        """Returns the policy whose joints follow another law, which must suit the robot."""
        law.check(self.robot)
        made = copy.copy(self)
        made.joint_law = law
        return made

    def explain(self, observation: Array, joint: int | str) -> Contributions:
        """Splits a joint's targets at observations (..., n) into parts that add up to them."""
        raise InputError(
            f"policies of kind {self.kind!r} do not split into contributions; take an additive, "
            "a linear or a symbolic one"
        )

    def factored_terms(self, joint: int) -> tuple[FactoredTerm, ...]:
        """Returns the factors of the terms of a joint's targets, in the order of `explain`."""
        raise InputError(f"policies of kind {self.kind!r} are not sums of terms; take another one")

    def importance(self, observations: Array) -> tuple[str, Array] | None:
        """Returns the method, and importances (12, n) by the policy's parts on samples (m, n)."""
        return None

    def refuse_other_machine(self, gait: "Gait") -> None:
        """Refuses a gait that differs from the file's gait or, without one, the shipped gait."""
        # Imported here: few programs that load a policy need gaits.
        from glassgait.models.task.gait import gait_names, shipped_gait  # noqa: PLC0415

        made_for, remedy = self.machine, "name the policy's file as the gait as well"
        if made_for is None and self.gait in gait_names():
            made_for, remedy = shipped_gait(self.gait), "name a policy whose file holds its machine"
        if made_for is not None and (key := made_for.first_difference(gait)) is not None:
            raise InputError(
                f"this policy was made for another machine than this {gait.name}, "
                f"which differs in {key!r}; {remedy}"
            )

    def check(
        self, *, gait: "Gait | str", observation_names: tuple[str, ...], robot: Robot | None = None
    ) -> None:
        """Refuses another robot, another gait or its name, or another layout of the observation."""
        # The robot and the gait, by name.
        name = gait if isinstance(gait, str) else gait.name
        made_for = "this policy was made for"
        if robot is not None and self.robot.name != robot.name:
            raise InputError(
                f"{made_for} robot {self.robot.name!r}, not {robot.name!r}; load one of that robot"
            )
        if self.gait != name:
            raise InputError(
                f"{made_for} gait {self.gait!r}, not {name!r}; name its gait, or another policy"
            )

        # The machine and the layout.
        if not isinstance(gait, str):
            self.refuse_other_machine(gait)
        ours, theirs = self.observation_names, observation_names
        if ours != theirs:
            first = next(
                (f"{a!r} instead of {b!r}" for a, b in zip(ours, theirs, strict=False) if a != b),
                f"{len(ours)} entries instead of {len(theirs)}",
            )
            raise InputError(f"this policy observes {first}; distil it again for this layout")


def first_not_finite(values: Array) -> tuple[int, ...] | None:
    found = np.argwhere(~np.isfinite(values))
    return tuple(int(index) for index in found[0]) if len(found) else None
