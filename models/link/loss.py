"""Messages that are lost on purpose."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Lt
from numpy.typing import NDArray

from glassgait.models.settings import NotNegative, Settings
from glassgait.models.task import CONTROL_PERIOD

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class Loss(Settings):
    """Which messages are lost.

    Attributes:
        share: Share of messages that are lost, each by itself.
        burst: Length of a time in which all are lost (s); 0 for none.
        interval: Time from the begin of a burst to the next (s).
    """

    title: ClassVar[str] = "loss"

    share: Annotated[float, Ge(0.0), Lt(1.0)] = 0.0
    burst: NotNegative = 0.0
    interval: Annotated[float, Ge(CONTROL_PERIOD)] = 10.0

    def draw(self, n_steps: int, n_channels: int, generator: np.random.Generator) -> BoolArray:
        """Draws which messages are lost.

        Args:
            n_steps: Control steps.
            n_channels: Channels, each with a message a step.
            generator: Source of randomness.

        Returns:
            Whether each message is lost (n_steps, n_channels). Bursts take all channels at once;
            the first comes in the middle of the first interval, give or take a quarter of it.
        """
        lost = generator.uniform(size=(n_steps, n_channels)) < self.share
        if self.burst > 0.0:
            period = round(self.interval / CONTROL_PERIOD)
            starts = np.arange(0, n_steps, period)
            starts = starts + generator.integers(period // 4, 3 * period // 4 + 1, len(starts))
            step = np.arange(n_steps)[:, None]
            length = round(self.burst / CONTROL_PERIOD)
            lost |= np.any((step >= starts) & (step < starts + length), axis=1)[:, None]
        return lost
