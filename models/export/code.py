"""What the C of a policy, or of a network, consists of."""

from dataclasses import dataclass

from glassgait.models.export.language import CArray


@dataclass(frozen=True)
class Code:
    """A part of a controller's file.

    Attributes:
        title: What it is, in a line.
        functions: Its functions; the last one is what others call.
        arrays: Its constant arrays, whose numbers stand at the end of the file.
        takes_state: Whether that function takes the machine's state first.
    """

    title: str
    functions: str
    arrays: tuple[CArray, ...] = ()
    takes_state: bool = False
