"""What every policy is, and the file format that all of them share."""

import copy
import hashlib
import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError, shown
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.files import load_arrays, save_arrays
from glassgait.models.policies.arrays import ArraySpec, narrowest, refuse_other_arrays, take_arrays
from glassgait.models.robots import quadruped
from glassgait.models.robots.joint_law import OWN_LAW, JointLaw
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import DEFAULT_ROBOT, Robot
from glassgait.models.task.gait import Gait, gait_names, shipped_gait
from glassgait.models.task.observation import (
    Group,
    ObservationLayout,
    indices_of,
    machine_state_entries,
)

if TYPE_CHECKING:
    from glassgait.models.formulas.expression import Expression

FORMAT_VERSION = 1

MAX_OBSERVATIONS = 256
MAX_NAME_LENGTH = 80
"""Characters of the name of a gait or of an observation."""

INTERCEPT = "intercept"
"""The constant among the terms of a target."""

_HEADER = {
    "kind": (str, "text"),
    "gait": (str, "text"),
    "observation_names": (list, "a list of names"),
    "values": (dict, "a mapping"),
}
"""Keys of a policy file's header, with what each must be; other keys are left alone."""


@dataclass(frozen=True)
class FactoredTerm:
    """A term of a joint's target: a weight times quantities, or a function of them.

    Attributes:
        weights: The weight, one for all RM states or one each; empty where the term is a function
            of its quantities.
        quantities: Variables of the policy, or functions of them.
        state: RM state whose formula the term is part of; None where it serves all.
    """

    weights: tuple[float, ...]
    quantities: "tuple[Expression, ...]"
    state: int | None = None


@dataclass(frozen=True)
class Contributions:
    """The parts that a joint's targets are sums of.

    Attributes:
        terms: What the parts come from (k).
        values: How much each adds (..., k; rad).
    """

    terms: tuple[str, ...]
    values: Array


def contributions_of_action(
    robot: Robot, terms: Sequence[str], values: Array, joint: int
) -> Contributions:
    """Turns parts of a joint's actions into parts of its targets.

    Args:
        terms: What the parts come from (k), the intercept first.
        values: How much each adds to the action (..., k).
        joint: Index of the joint, whose default stance the intercept takes up.
    """
    of_target = robot.action_scale * values
    of_target[..., 0] += robot.default_stance[joint]
    return Contributions(tuple(terms), of_target)


class Policy(ABC):
    """A callable `observation (..., n) -> action (..., 12)` that knows what it observes.

    Policies are immutable: a systems diagram may share one between contexts and clones.

    A policy that was built is sound: its names and its arrays are checked here, for every kind and
    for every source alike.

    Attributes:
        kind: Name of the sort of policy, as in files and on the command line.
        robot: The robot that it was made for.
        gait: Name of the gait it was made for.
        observation_names: Names of the observations, in order.
        joint_law: How the joints that it moves are to follow its targets, which it learned with.
        observes_by: Digest of the expert whose estimator it observes by; None where it has none, or
            its own.
        machine: The gait itself, where the policy's file holds it.
    """

    observes_by: str | None = None
    machine: Gait | None = None
    _estimator: Callable[[Array], Array] | Odometry | None = None

    kind: ClassVar[str]
    joint_law: JointLaw = OWN_LAW
    suffix: ClassVar[str] = ".safetensors"
    """How the names of its files end."""
    array_specs: ClassVar[Mapping[str, ArraySpec]] = {}
    """What the policy's arrays must be; their names are its attributes and its arguments."""
    needed_groups: ClassVar[tuple[Group, ...]] = ()
    """Groups of observations that this kind of policy asks for."""

    def __init__(
        self,
        gait: str,
        observation_names: Sequence[str],
        *in_order: NDArray[Any],
        robot: Robot | None = None,
        **arrays: NDArray[Any],
    ) -> None:
        """
        Args:
            observation_names: Names of the observations, in order.
            in_order: The first of what `array_specs` lists, in its order.
            robot: The robot that it is made for; the default one by default.
            arrays: The others, by name.

        Raises:
            InputError: if a name or an array is not what it must be.
        """
        if len(in_order) > len(self.array_specs):
            raise TypeError(f"{self.kind} policy: takes {len(self.array_specs)} arrays")
        arrays |= zip(self.array_specs, in_order, strict=False)
        with self._naming_this_kind():
            _refuse_other_than_names("the gait", [gait])
            taken = take_arrays(arrays, self.array_specs, self._sizes(observation_names))
        self.robot = robot or load_robot()
        self.gait = gait
        self.observation_names = tuple(observation_names)
        for name, array in taken.items():
            setattr(self, name, array)

    @classmethod
    def _sizes(cls, observation_names: Sequence[str]) -> dict[str, int]:
        """Returns the sizes that the arrays of any policy may have.

        Raises:
            InputError: if the names cannot be those of the observations.
        """
        _refuse_other_than_observations(observation_names, cls.needed_groups)
        return {
            "joints": quadruped.N_JOINTS,
            "observations": len(observation_names),
            "states": len(indices_of("machine state", observation_names)),
        }

    @classmethod
    @contextmanager
    def _naming_this_kind(cls) -> Iterator[None]:
        """Puts the kind of policy before what is wrong with it."""
        try:
            yield
        except InputError as error:
            raise InputError(f"{cls.kind} policy: {error}") from error

    @abstractmethod
    def __call__(self, observation: Array) -> Array:
        """Maps observations (..., n) to actions (..., 12)."""

    def to_arrays(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Returns what distinguishes this policy: named arrays, and values that JSON can hold."""
        return {name: getattr(self, name) for name in self.array_specs}, {}

    @classmethod
    def from_arrays(
        cls, arrays: Mapping[str, NDArray[Any]], values: Mapping[str, Any], **names: Any
    ) -> Self:
        """Rebuilds the policy that `to_arrays` took apart.

        Args:
            names: Its `gait`, `observation_names` and `robot`.

        Raises:
            InputError: if a part is missing, left over, or not what it must be.
        """
        with cls._naming_this_kind():
            refuse_other_arrays(arrays, cls.array_specs)
        if "robot" in names and names["robot"].name == DEFAULT_ROBOT:
            # A class of one's own may know of the default robot alone.
            del names["robot"]
        parts: dict[str, Any] = names | dict(arrays)
        return cls(**parts)

    def with_arrays(self, **changed: NDArray[Any]) -> Self:
        """Returns the policy with some arrays changed, and no estimator from elsewhere."""
        arrays: dict[str, Any] = {name: getattr(self, name) for name in self.array_specs}
        arrays |= changed
        own = type(self)(self.gait, self.observation_names, robot=self.robot, **arrays)
        return own.with_joint_law(self.joint_law)

    @cached_property
    def _one_hot(self) -> slice:
        return machine_state_entries(self.observation_names)

    def machine_state(self, observation: Array) -> NDArray[np.intp]:
        """Returns the index of the machine's state in observations (..., n)."""
        return np.argmax(observation[..., self._one_hot], axis=-1)

    @property
    def layout(self) -> ObservationLayout:
        """The layout of what it observes."""
        return ObservationLayout.of(self.observation_names)

    @property
    def estimator(self) -> Callable[[Array], Array] | Odometry | None:
        """Odometry, or what maps proprioception (..., 40 + n_states) to the body state (..., 7).

        None without one.
        """
        return self._estimator

    def with_estimator_of(self, expert: "Policy") -> Self:
        """Returns the policy with the estimator that it was distilled with, its expert's.

        Files hold no estimator: a policy that was loaded from one has none until it is given one.

        Raises:
            InputError: if the expert is of another gait.
        """
        if expert.gait != self.gait:
            raise InputError(
                f"the expert is of the {expert.gait} and the policy of the {self.gait}; name the "
                f"expert of the {self.gait}"
            )
        own = copy.copy(self)
        own.observes_by, own._estimator = expert.digest(), expert.estimator
        return own

    def with_joint_law(self, law: JointLaw) -> Self:
        """Returns the policy whose joints are to follow another law.

        Raises:
            InputError: if its limits count torques by less than the joints' stiffness.
        """
        law.check(self.robot)
        own = copy.copy(self)
        own.joint_law = law
        return own

    def explain(self, observation: Array, joint: int | str) -> Contributions:
        """Splits a joint's targets into contributions that add up to them.

        Args:
            observation: Observations (..., n).
            joint: Index of the joint, or its name.

        Raises:
            InputError: if there is no such joint, or this kind of policy has no such parts.
        """
        return self._explain(observation, quadruped.joint_index(joint))

    def factored_terms(self, joint: int) -> tuple[FactoredTerm, ...]:
        """Returns what the terms of a joint's targets are made of, in the order of `explain`.

        Raises:
            InputError: if this kind of policy has no such terms.
        """
        raise self._without_terms()

    def importance(self, observations: Array) -> tuple[str, Array] | None:
        """Returns the importance of observations that the policy's parts give.

        Args:
            observations: Observations (m, n).

        Returns:
            The name of the method, and an array (12, n); None for policies without such parts.
        """
        return None

    def _explain(self, observation: Array, joint: int) -> Contributions:
        raise self._without_terms()

    def _without_terms(self) -> InputError:
        return InputError(
            f"policies of kind {self.kind!r} do not split into contributions; take an additive, "
            "a linear or a symbolic one"
        )

    def save(self, path: Path) -> None:
        """Writes the policy to a safetensors file, atomically, and no number wider than it is."""
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
        save_arrays(path, {name: narrowest(array) for name, array in arrays.items()}, header)

    def compact(self) -> Self:
        """Returns the policy with numbers that its file holds in less space, where that helps."""
        return self

    def digest(self) -> str:
        """Returns what differs where policies would not act alike."""
        arrays, values = self.to_arrays()
        whole = hashlib.sha256(json.dumps([*self._named(), values]).encode())
        if law := self.joint_law.to_plain():
            whole.update(json.dumps(law).encode())
        for name in sorted(arrays):
            whole.update(name.encode() + np.ascontiguousarray(arrays[name]).tobytes())
        return whole.hexdigest()[:16]

    def _named(self) -> list[str]:
        """Returns kind and gait, and the robot where it is not the default one."""
        robot = [] if self.robot.name == DEFAULT_ROBOT else [self.robot.name]
        return [self.kind, self.gait, *robot]

    def refuse_other_machine(self, gait: Gait) -> None:
        """Refuses a gait of the policy's name that is not the one it was made for.

        That is the gait which its file holds; where it holds none the one that ships by that name.

        Raises:
            InputError: if it differs; the message names the key.
        """
        if self.machine is not None:
            own = self.machine
            remedy = "name the policy's file as the gait as well; in Python, give policy.machine"
        elif self.gait in gait_names():
            own, remedy = shipped_gait(self.gait), "name a policy whose file holds that machine"
        else:
            return
        if (key := own.first_difference(gait)) is not None:
            raise InputError(
                f"this policy was made for another machine than this {gait.name}, "
                f"which differs in {key!r}; {remedy}"
            )

    def check(
        self, *, gait: Gait | str, observation_names: tuple[str, ...], robot: Robot | None = None
    ) -> None:
        """Refuses to serve another robot, another gait or another observation layout.

        Args:
            gait: The gait, or its name where no more is known of it.
            observation_names: Names of the observations, in order.
            robot: The robot.

        Raises:
            InputError: if one differs; the message names the difference.
        """
        if robot is not None and self.robot.name != robot.name:
            raise InputError(
                f"this policy was made for robot {self.robot.name!r}, not "
                f"{robot.name!r}; load a policy of that robot"
            )
        name = gait if isinstance(gait, str) else gait.name
        if self.gait != name:
            raise InputError(
                f"this policy was made for gait {self.gait!r}, not {name!r}; name its gait with "
                f"--gait, or a policy of the {name}"
            )
        if not isinstance(gait, str):
            self.refuse_other_machine(gait)
        if self.observation_names != observation_names:
            ours, theirs = self.observation_names, observation_names
            first = next(
                (f"{a!r} instead of {b!r}" for a, b in zip(ours, theirs, strict=False) if a != b),
                f"{len(ours)} entries instead of {len(theirs)}",
            )
            raise InputError(f"this policy observes {first}; distil it again for this layout")


def refuse_other_expert(expert: Policy, student: Policy, *, both_act: bool) -> None:
    """Refuses an expert whose estimator is not the one that a student observes by.

    Where both act their joints need the same gains and limits as well.

    Args:
        expert: The expert.
        student: The student. Where it has odometry of its own and acts alone, any expert will do.
        both_act: Whether the expert acts as well.

    Raises:
        InputError: if it is not.
    """
    own = student.estimator
    if both_act and isinstance(own, Odometry) and own != expert.estimator:
        raise InputError(
            f"this {student.kind} student of the {student.gait} has odometry of its own, which is "
            "not the estimator of the expert that acts with it; let one of them act alone"
        )
    if student.observes_by not in (None, expert.digest()):
        raise InputError(
            f"this {student.kind} student of the {student.gait} observes by the estimator of the "
            f"expert {student.observes_by}, not by that of {expert.digest()}; give it the expert "
            "that it was distilled with"
        )
    law = student.joint_law.over(expert.joint_law)
    gains, theirs = law.gains_of(expert.robot), expert.joint_law.gains_of(expert.robot)
    if both_act and gains != theirs:
        raise InputError(
            f"this {student.kind} student of the {student.gait} moves joints of gains {gains}, and "
            f"the expert that acts with it those of {theirs}; let one of them act alone"
        )
    if both_act and law.limits != expert.joint_law.limits:
        raise InputError(
            f"this {student.kind} student of the {student.gait} has other limits of its targets "
            "than the expert that acts with it; let one of them act alone"
        )


def read_policy_file(path: Path) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Reads the arrays and the header of a policy file.

    Raises:
        InputError: if the file is missing, damaged or of another format, or its header lacks a key
            or holds something else in one.
    """
    arrays, header = load_arrays(path)
    version = header.get("format") if isinstance(header, dict) else None
    if type(version) is not int or version != FORMAT_VERSION:
        raise InputError(f"{path}: is not a policy of format {FORMAT_VERSION}; make it anew")
    for key, (kind, wanted) in _HEADER.items():
        if key not in header:
            raise InputError(f"{path}: its header lacks the key {key!r}; make it anew")
        if not isinstance(header[key], kind):
            found = type(header[key]).__name__
            raise InputError(
                f"{path}: key {key!r} of its header is of type {found}; it must be {wanted}, so "
                "make the policy anew"
            )
    return arrays, header


def first_not_finite(values: Array) -> tuple[int, ...] | None:
    """Finds the first entry that is not finite.

    Returns:
        Its index along each axis, or None.
    """
    found = np.argwhere(~np.isfinite(values))
    return tuple(int(index) for index in found[0]) if len(found) else None


def _refuse_other_than_names(what: str, names: Sequence[str]) -> None:
    for name in names:
        if not isinstance(name, str) or not 0 < len(name) <= MAX_NAME_LENGTH:
            given = shown(name) if isinstance(name, str) else f"of type {type(name).__name__}"
            raise InputError(
                f"{what} is {given}; it must be text of 1 to {MAX_NAME_LENGTH} characters, so make "
                "the policy anew"
            )
        if not name.isprintable():
            raise InputError(f"{what} is {shown(name)}; it must be printable, so make it anew")


def _refuse_other_than_observations(names: Sequence[str], needed: tuple[Group, ...]) -> None:
    if not isinstance(names, tuple | list) or not 0 < len(names) <= MAX_OBSERVATIONS:
        raise InputError(
            f"it must have from 1 to {MAX_OBSERVATIONS} names of observations; make it anew"
        )
    _refuse_other_than_names("the name of an observation", names)
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"observes {shown(twice)} twice; make it anew")
    for entry in ObservationLayout(n_machine_states=1).entries:
        if entry.group in needed and entry.name not in names:
            raise InputError(f"does not observe {entry.name!r}, which it needs; make it anew")
    states = indices_of("machine state", names)
    layout = ObservationLayout(len(states))
    wanted = [entry.name for entry in layout.entries if entry.group == "machine state"]
    start = states[0] if states else 0
    if list(names[start : start + len(states)]) != wanted:
        raise InputError("does not observe RM State 0, RM State 1, … in a row; make it anew")
