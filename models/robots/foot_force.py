"""How force sensors of feet are read."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from annotated_types import Ge, Gt, Le

from glassgait.models.errors import InputError
from glassgait.models.settings import Settings


@dataclass(frozen=True)
class FootForce(Settings):
    """How the feet's force sensors are read, which count in units of their own.

    Attributes:
        release: A foot that touches does so until its sensor counts no more than this.
        touch: One that does not touch does from this count on.
        per_newton: Counts of a newton, by which a simulated robot's sensors count.
    """

    title: ClassVar[str] = "foot_force"

    release: Annotated[float, Ge(0.0), Le(30000.0)]
    touch: Annotated[float, Gt(0.0), Le(30000.0)]
    per_newton: Annotated[float, Gt(0.0), Le(1000.0)]

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.release >= self.touch:
            raise InputError(
                f"foot_force: release is {self.release:g}; give one below touch = {self.touch:g}"
            )
