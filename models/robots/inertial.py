"""Mass and inertia of a body."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.settings import Positive, Settings

PHYSICAL = 1e-6
"""By how much two principal moments may be less than the third, over it: files round them."""

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Inertial(Settings):
    """Mass (kg), centre of mass (m) and inertia about it (kg·m²) of a body, in the body's axes."""

    title: ClassVar[str] = "inertia"

    mass: Positive
    center: Triple
    ixx: Positive
    ixy: float
    ixz: float
    iyy: Positive
    iyz: float
    izz: Positive

    @property
    def matrix(self) -> Array:
        """The inertia about the centre of mass (3, 3)."""
        return np.array(
            [
                [self.ixx, self.ixy, self.ixz],
                [self.ixy, self.iyy, self.iyz],
                [self.ixz, self.iyz, self.izz],
            ]
        )

    def check(self, name: str) -> None:
        """
        Args:
            name: What the body is called among inertias.

        Raises:
            InputError: if no body can have this inertia.
        """
        least, middle, greatest = np.linalg.eigvalsh(self.matrix).tolist()
        if least <= 0.0 or least + middle < (1.0 - PHYSICAL) * greatest:
            raise InputError(
                f"inertias has {name} as no body can be: of its principal moments, {least:.4g}, "
                f"{middle:.4g} and {greatest:.4g} kg·m², two must be at least the third, and all "
                "positive; mend a moment, or a product such as ixy"
            )
