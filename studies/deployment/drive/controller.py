"""The controller's process: it answers sensors as they come."""

import time
from collections import deque
from collections.abc import Callable

import numpy as np
from pydrake.lcm import DrakeLcmInterface

from glassgait.diagrams.link import ControllerEnd
from glassgait.studies.common.console import say
from glassgait.studies.deployment.drive.foreign import ForeignMessages
from glassgait.studies.deployment.drive.pace import KEPT, spread
from glassgait.studies.deployment.drive.simulator import Record

LISTENING = 100
"""Time for which it listens before it asks whether to end (ms)."""

SILENCE = 1.0
"""Time without sensors that is reported (s)."""


def control(
    controller: ControllerEnd, lcm: DrakeLcmInterface, stopped: Callable[[], bool]
) -> Record:
    """Answers until it is asked to end.

    Args:
        controller: The controller.
        lcm: Where its messages go.
        stopped: Asked every 0.1 s or more often whether to end.

    Returns:
        What was counted, by name.
    """
    taken: deque[float] = deque(maxlen=KEPT)
    answered, last, hears, foreign = 0, time.monotonic(), False, ForeignMessages()
    while not stopped():
        lcm.HandleSubscriptions(LISTENING)
        foreign.say(controller.n_foreign)
        now = time.monotonic()
        if controller.answer():
            answered, last = answered + 1, time.monotonic()
            taken.append(last - now)
            if not hears:
                say("answering a robot")
                hears = True
        elif hears and now - last > SILENCE:
            say("the robot is silent")
            hears = False
    return {
        "answers sent": answered,
        **{f"sensors {name}": count for name, count in controller.tally.rows().items()},
        "messages of another kind": controller.n_foreign,
        "robots heard": controller.tally.sessions,
        **spread("time of a step", np.array(taken)),
    }
