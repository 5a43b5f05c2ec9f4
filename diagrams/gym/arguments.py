"""Checks of what a person gives the environments."""

from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from glassgait.diagrams.batch import BoolArray
from glassgait.diagrams.controller import Senses
from glassgait.models.arrays import Array
from glassgait.models.errors import InputError, shown
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.policies.library import find_gait
from glassgait.models.task.gait import Gait

SENSES = {
    "true": Senses(),
    "odometry": Senses(estimator=Odometry()),
    "imu": Senses(observes_imu=True, estimator=Odometry()),
}
"""What the body state is observed by: its true values or odometry; with `imu` gravity's direction
and the angular velocity are observed as well."""


def gait_given(gait: Gait | str | Path) -> Gait:
    """Returns a gait as it is, or loads it by its name or file.

    Raises:
        InputError: if there is no such gait, or its file breaks a rule.
    """
    if isinstance(gait, Gait):
        return gait
    if not isinstance(gait, str | Path):
        raise InputError(
            f"environment: gait is {shown(gait)}; give a gait's name, the path of a gait file, or "
            "a Gait"
        )
    return find_gait(gait)


def find_senses(senses: str) -> Senses:
    """Returns what is observed by, by its name.

    Raises:
        InputError: if there is none that is called so.
    """
    if senses not in SENSES:
        raise InputError(
            f"environment: senses is {shown(senses)}; give one of {', '.join(map(repr, SENSES))}"
        )
    return SENSES[senses]


def check_actions(actions: Any, shape: tuple[int, ...]) -> Array:
    """Returns actions as an array of finite numbers; those outside the space are taken as they are.

    Raises:
        InputError: if the actions are of another shape, or not all finite numbers.
    """
    try:
        array = np.asarray(actions, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(f"step: {shown(actions)} is no array of numbers; give one") from error
    if array.shape != shape:
        raise InputError(f"step: the actions have shape {array.shape}; give them in shape {shape}")
    if not np.isfinite(array).all():
        where = tuple(np.argwhere(~np.isfinite(array))[0].tolist())
        raise InputError(
            f"step: the actions hold {array[where]} at {where}; give finite numbers, or end what "
            "made them"
        )
    return array


def check_num_envs(num_envs: Any) -> int:
    """Returns a number of robots.

    Raises:
        InputError: if it is no whole number of 1 or more.
    """
    whole = isinstance(num_envs, int | np.integer) and not isinstance(num_envs, bool)
    if not whole or num_envs < 1:
        raise InputError(
            f"environment: num_envs is {shown(num_envs)}; it must be a whole number, 1 or more"
        )
    return int(num_envs)


def find_autoreset_mode(mode: AutoresetMode | str) -> AutoresetMode:
    """Returns an autoreset mode by its value, such as "NextStep", or as it is.

    Raises:
        InputError: if there is no such mode.
    """
    try:
        return AutoresetMode(mode)
    except ValueError as error:
        modes = ", ".join(repr(known.value) for known in AutoresetMode)
        raise InputError(
            f"environment: autoreset_mode is {shown(mode)}; give one of {modes}"
        ) from error


def find_reset_mask(options: dict[str, Any] | None, num_envs: int) -> BoolArray:
    """Returns which robots (n,) a reset is for: by default all.

    Raises:
        InputError: if `options["reset_mask"]` is no array of n booleans, or all are false.
    """
    given = (options or {}).get("reset_mask")
    if given is None:
        return np.ones(num_envs, dtype=bool)
    mask = np.asarray(given)
    if mask.dtype != bool or mask.shape != (num_envs,) or not mask.any():
        raise InputError(
            f"reset: reset_mask is {shown(given)}; give an array of {num_envs} booleans, one or "
            "more of them true"
        )
    return mask
