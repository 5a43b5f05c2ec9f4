"""What the C of a policy, or of a network, consists of."""

from dataclasses import dataclass

from glassgait.models.export.language import LINE_LENGTH, CArray, Real


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


def act_signature(own: str, real: Real, *, takes_state: bool) -> str:
    """Declares the function that acts, on as many lines as it takes.

    Args:
        own: What the names of its gait begin with, such as `trot_`; empty where there is one gait.
        real: The type that is computed in.
        takes_state: Whether it takes the machine's state first.
    """
    begin = f"static void {own}act({'int state, ' if takes_state else ''}"
    observed = f"const {real} observation[{own.upper()}N_OBSERVATIONS],"
    whole = f"{begin}{observed} {real} action[12])"
    return whole if len(whole) <= LINE_LENGTH else f"{begin}{observed}\n    {real} action[12])"
