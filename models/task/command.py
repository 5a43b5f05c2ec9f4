"""Commands: forward speed, yaw rate and rhythm."""

from typing import NamedTuple

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError, shown
from glassgait.models.task.gait import Gait

DEAD_BAND = 0.2  # commanded speeds below this (m/s) become 0


class Command(NamedTuple):
    """Forward speed and yaw rate (..., 2; m/s, rad/s), and the rhythm.

    `dwell` is the number of control steps to stay in a state of the reward machine (...).
    """

    velocity: Array
    dwell: Array


def sample_commands(
    gait: Gait,
    count: int,
    generator: np.random.Generator,
    speed_range: tuple[float, float] | None = None,
    *,
    straight: float = 0.0,
) -> Command:
    """Draws commands: velocities (count, 2) and dwells (count,).

    Forward speeds are in `speed_range` (m/s), by default the gait's whole range. `straight` is the
    share of commands without a yaw rate.
    """
    slowest, fastest = speed_range or (-gait.max_speed, gait.max_speed)
    speed = generator.uniform(slowest, fastest, size=count)
    yaw_rate = generator.uniform(-gait.max_yaw_rate, gait.max_yaw_rate, size=count)
    velocity = np.stack([speed, yaw_rate], axis=1)
    velocity[np.abs(velocity[:, 0]) < DEAD_BAND, 0] = 0.0
    if straight > 0.0:
        velocity[generator.random(count) < straight, 1] = 0.0
    low, high = gait.dwell
    return Command(velocity, generator.integers(low, high + 1, size=count).astype(float))


def limit_command(gait: Gait, command: Command) -> Command:
    """Clips a command to a gait's ranges."""
    greatest = np.array([gait.max_speed, gait.max_yaw_rate])
    return Command(
        np.clip(command.velocity, -greatest, greatest), np.clip(command.dwell, *gait.dwell)
    )


def check_command(gait: Gait, prefix: str = "command: ", **given: float) -> None:
    """Refuses a `speed` (m/s), `yaw_rate` (rad/s) or `dwell` (control steps) out of range."""
    ranges = {
        "speed": (-gait.max_speed, gait.max_speed),
        "yaw_rate": (-gait.max_yaw_rate, gait.max_yaw_rate),
        "dwell": gait.dwell,
    }
    for name, value in given.items():
        least, greatest = ranges[name]
        if not least <= value <= greatest:
            raise InputError(
                f"{prefix}{name} is {shown(value)}; give {least:g} to {greatest:g}, the range of "
                f"gait {gait.name!r}"
            )


def on_the_spot(gait: Gait) -> Command:
    """Returns the command to step on the spot, at the middle of the gait's rhythm."""
    return Command(np.zeros(2), np.array(float(sum(gait.dwell) // 2)))


def sound_command(gait: Gait, command: Command) -> Command:
    """Clips a command to a gait's ranges; returns `on_the_spot` if it is not finite."""
    finite = np.isfinite([*command.velocity, command.dwell]).all()
    return limit_command(gait, command) if finite else on_the_spot(gait)
