"""What a page may ask for: each message is checked before anything is done."""

from typing import Annotated, Any, ClassVar, Literal, get_args

from annotated_types import Ge, Le, Lt, MaxLen

from glassgait.models.errors import InputError, shown
from glassgait.models.robots import quadruped
from glassgait.models.settings import Settings, checked

Name = Annotated[str, MaxLen(80)]

MOST_AXES = 32
"""Axes that a gamepad may have; browsers report the sticks first."""


@checked
class Choose(Settings):
    """Show the formula of another place: its number among those that the file holds."""

    title: ClassVar[str] = "choose"

    place: Annotated[int, Ge(0)]


@checked
class Joint(Settings):
    """Draw another joint in the browser that asks, where there are no formulas."""

    title: ClassVar[str] = "joint"

    joint: Annotated[int, Ge(0), Lt(quadruped.N_JOINTS)]


@checked
class Shown(Settings):
    """Say that the page has taken what it was sent, up to a message of this number."""

    title: ClassVar[str] = "shown"

    number: Annotated[int, Ge(0)]


@checked
class Coefficient(Settings):
    """Change what a term of the formula that is shown is multiplied by.

    Attributes:
        term: Number of the term.
        value: Its new coefficient.
        goes_on: Whether it is still being dragged.
    """

    title: ClassVar[str] = "coefficient"

    term: Annotated[int, Ge(0)]
    value: float
    goes_on: bool = False


@checked
class Number(Settings):
    """Change a number of a definition.

    Attributes:
        index: Its place among the numbers of the file.
        value: What it is to be.
    """

    title: ClassVar[str] = "number"

    index: Annotated[int, Ge(0)]
    value: float


@checked
class Switch(Settings):
    """Switch a term of the formula that is shown off or on."""

    title: ClassVar[str] = "switch"

    term: Annotated[int, Ge(0)]
    on: bool


@checked
class Steer(Settings):
    """Command the robot: forward speed (m/s), yaw rate (rad/s), dwell (control steps)."""

    title: ClassVar[str] = "steer"

    speed: float
    yaw_rate: float
    dwell: float


@checked
class Gamepad(Settings):
    """Command the robot by a gamepad, for a moment.

    Attributes:
        axes: Its axes, -1 to 1; none where the gamepad is gone, which is then untouched.
    """

    title: ClassVar[str] = "gamepad"

    axes: Annotated[tuple[float, ...], MaxLen(MOST_AXES)]


@checked
class Push(Settings):
    """Push the trunk: where to (°, 0 ahead, 90 to the left), and how much (m/s)."""

    title: ClassVar[str] = "push"

    angle: Annotated[float, Ge(-360.0), Le(360.0)]
    speed: Annotated[float, Ge(0.0), Le(3.0)]


@checked
class Surroundings(Settings):
    """Change the ground's slope (°) and how late actions are (s); the robots begin anew."""

    title: ClassVar[str] = "surroundings"

    slope: Annotated[float, Ge(-30.0), Le(30.0)]
    latency: Annotated[float, Ge(0.0), Le(0.04)]


@checked
class Ghost(Settings):
    """Let the ghost walk, or not."""

    title: ClassVar[str] = "ghost"

    walks: bool


@checked
class Evaluate(Settings):
    """Count falls in scenarios that ship."""

    title: ClassVar[str] = "evaluate"

    scenarios: Annotated[tuple[Name, ...], MaxLen(60)]


@checked
class Act(Settings):
    """Do one of the things that need no more words."""

    title: ClassVar[str] = "act"

    what: Literal[
        "pause", "go", "step", "restart", "undo", "redo", "reset", "verify", "halt work", "save"
    ]


Message = (
    Choose
    | Joint
    | Shown
    | Coefficient
    | Number
    | Switch
    | Steer
    | Gamepad
    | Push
    | Surroundings
    | Ghost
    | Evaluate
    | Act
)

_KINDS: dict[str, type[Settings]] = {kind.title: kind for kind in get_args(Message)}


def read_message(values: Any) -> Message:
    """Reads what a page sent.

    Args:
        values: Plain values: the message's kind under `kind`, and its fields.

    Raises:
        InputError: if it is no message, or a field is not what it must be.
    """
    named = values.get("kind") if isinstance(values, dict) else None
    kind = _KINDS.get(named) if isinstance(named, str) else None
    if kind is None:
        raise InputError(f"message {shown(str(named)[:80])} is none that the studio knows")
    rest = {key: value for key, value in values.items() if key != "kind"}
    message: Any = kind.from_plain(rest, kind.title)
    return message
