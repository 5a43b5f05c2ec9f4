"""What every policy is, and the file format that all of them share."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

from numpy.typing import NDArray

from models.a1.robot import Array
from models.errors import InputError
from models.files import load_arrays, save_arrays
from models.policies.precision import narrowest, widened

FORMAT_VERSION = 1

INTERCEPT = "intercept"
"""The constant among the terms of an action."""


@dataclass(frozen=True)
class Contributions:
    """The parts that a joint's actions are sums of.

    Attributes:
        terms: What the parts come from (k).
        values: How much each adds (..., k).
    """

    terms: tuple[str, ...]
    values: Array


class Policy(ABC):
    """A callable `observation (..., n) -> action (..., 12)` that knows what it observes.

    Policies are immutable: a systems diagram may share one between contexts and clones.

    Attributes:
        kind: Name of the sort of policy, as in files and on the command line.
        gait: Name of the gait it was made for.
        observation_names: Names of the observations, in order.
    """

    kind: ClassVar[str]
    array_names: ClassVar[tuple[str, ...]] = ()
    """Attributes, and arguments of the constructor, that are the policy's arrays."""

    def __init__(self, gait: str, observation_names: tuple[str, ...]) -> None:
        self.gait = gait
        self.observation_names = observation_names

    @abstractmethod
    def __call__(self, observation: Array) -> Array:
        """Maps observations (..., n) to actions (..., 12)."""

    def to_arrays(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Returns what distinguishes this policy: named arrays, and values that JSON can hold."""
        return {name: getattr(self, name) for name in self.array_names}, {}

    @classmethod
    def from_arrays(
        cls,
        gait: str,
        observation_names: tuple[str, ...],
        arrays: Mapping[str, NDArray[Any]],
        values: Mapping[str, Any],
    ) -> Self:
        """Rebuilds the policy that `to_arrays` took apart."""
        own = {name: widened(arrays[name]) for name in cls.array_names}
        return cls(gait, observation_names, **own)

    def explain(self, observation: Array, joint: int) -> Contributions:
        """Splits a joint's actions into contributions that add up to them.

        Args:
            observation: Observations (..., n).
            joint: Index of the joint.

        Raises:
            InputError: if this kind of policy has no such parts.
        """
        raise InputError(
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
        save_arrays(path, {name: narrowest(array) for name, array in arrays.items()}, header)

    def check(self, *, gait: str, observation_names: tuple[str, ...]) -> None:
        """Refuses to serve another gait or another observation layout.

        Raises:
            InputError: if either differs; the message names the difference.
        """
        if self.gait != gait:
            raise InputError(
                f"this {self.kind} policy was made for gait {self.gait!r}, not {gait!r}; "
                "load the policy of that gait"
            )
        if self.observation_names != observation_names:
            ours, theirs = self.observation_names, observation_names
            first = next(
                (f"{a!r} instead of {b!r}" for a, b in zip(ours, theirs, strict=False) if a != b),
                f"{len(ours)} entries instead of {len(theirs)}",
            )
            raise InputError(
                f"this {self.kind} policy observes {first}; distil it again for this layout"
            )


def read_policy_file(path: Path) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Reads the arrays and the header of a policy file.

    Raises:
        InputError: if the file is missing, damaged or of another format.
    """
    arrays, header = load_arrays(path)
    if header.get("format") != FORMAT_VERSION or "kind" not in header:
        raise InputError(f"{path}: is not a policy of format {FORMAT_VERSION}; make it anew")
    return arrays, header
