"""What the C of a policy, or of a network, consists of."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from glassgait.models.errors import InputError
from glassgait.models.export.language import LINE_LENGTH, CArray, Real
from glassgait.models.policies.policy import Policy
from glassgait.models.task.symmetry import Reflection


@dataclass(frozen=True)
class Code:
    """A part of a controller's file.

    Attributes:
        title: What it is, in a line.
        functions: Its functions; the last one is what others call.
        arrays: Its constant arrays, whose numbers stand at the end of the file.
        takes_state: Whether that function takes the machine's state first.
        helpers: Functions that it calls and shares with other policies of the file.
    """

    title: str
    functions: str
    arrays: tuple[CArray, ...] = ()
    takes_state: bool = False
    helpers: tuple[str, ...] = ()


@dataclass(frozen=True)
class Style:
    """How a policy is written.

    Attributes:
        constants: Name of the constant of each state of the machine.
        real: The type that is computed in.
        own: What the names of its gait begin with, such as `trot_`; none where there is one gait.
    """

    constants: Sequence[str]
    real: Real
    own: str = ""

    @property
    def begin(self) -> str:
        """What names of constants begin with."""
        return self.own.upper()

    def signature(self, *, takes_state: bool, name: str = "act", writes: str = "action") -> str:
        """Declares a function of the observation, on as many lines as it takes.

        Args:
            takes_state: Whether it takes the machine's state first.
            name: Its name, behind what names of its gait begin with; by default that which acts.
            writes: What it writes of each joint.
        """
        begin = f"static void {self.own}{name}({'int state, ' if takes_state else ''}"
        observed = f"const {self.real} observation[{self.begin}N_OBSERVATIONS],"
        rest = f"{self.real} {writes}[12])"
        whole = f"{begin}{observed} {rest}"
        return whole if len(whole) <= LINE_LENGTH else f"{begin}{observed}\n    {rest}"


def reflection_arrays(prefix: str, reflection: Reflection) -> list[CArray]:
    """Writes what a vector is in the mirror: two arrays, whose names begin with the prefix."""
    index, sign = reflection.index, reflection.sign.astype(np.int8)
    return [
        CArray.of_indices(f"{prefix}_IMAGE", index, "in the mirror an entry is this one"),
        CArray(f"{prefix}_SIGN", sign, "signed char", "times this sign"),
    ]


def policy_code(policy: Policy, style: Style) -> Code:
    """Writes a policy; its last function maps the observation to the action.

    Raises:
        InputError: if there is no C for its kind.
    """
    write = policy.capabilities.function("code")
    if write is None:
        raise InputError(f"there is no C for policies of kind {policy.kind!r}; export another one")
    return write(policy, style)
