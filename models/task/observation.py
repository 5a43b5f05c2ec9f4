"""What a policy sees: the layout of the observation, with the names that the paper's tables use."""

from functools import cached_property

import numpy as np

from glassgait.models.a1 import kinematics, robot
from glassgait.models.a1.robot import Array

JOINT_VELOCITY_SCALE = 0.05
ITERATIONS_SCALE = 0.1
BASE_VELOCITY_SCALE = 2.0

JOINT_POSITION_NOISE = 0.01
"""Half-width of the uniform noise on observed joint positions (rad)."""

JOINT_VELOCITY_NOISE = 1.5
"""Half-width of the uniform noise on observed joint velocities (rad/s)."""

JOINT_NOISE: Array = np.repeat([JOINT_POSITION_NOISE, JOINT_VELOCITY_NOISE], robot.N_JOINTS)
"""Half-widths of the noise on joint positions, then velocities (24)."""
JOINT_NOISE.flags.writeable = False

N_ESTIMATED = 7
"""Length of the part that a deployed robot has to estimate: base velocity and foot heights."""

STATE_ENTRY = "RM State "
"""How the names of the machine's states begin; their numbers follow."""

_UNITS = {
    "Command X": "m/s",
    "Command Yaw": "rad/s",
    "DoF Pos": "rad from the default stance",
    "DoF Vel": f"{JOINT_VELOCITY_SCALE} · rad/s",
    "Prev Action": f"{robot.ACTION_SCALE} rad of joint target",
    "RM State": "0 or 1",
    "RM Iters": f"{ITERATIONS_SCALE} · control steps",
    "Command RM Iters": f"{ITERATIONS_SCALE} · control steps",
    "Base Lin Vel": f"{BASE_VELOCITY_SCALE:g} · m/s",
    "Foot Height": "m",
}
"""Units by the start of an entry's name, with the factor that the entry is scaled by."""

_JOINT_TITLES = tuple(f"{leg} {joint.title()}" for leg in robot.LEGS for joint in robot.LEG_JOINTS)


class ObservationLayout:
    """Names and order of the observation for a machine of `n_machine_states` states.

    The first part, proprioception, is measured or known; the last seven entries, the body state,
    come from an estimator.
    """

    def __init__(self, n_machine_states: int) -> None:
        self.n_machine_states = n_machine_states

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of all entries, in order."""
        return (
            "Command X",
            "Command Yaw",
            *(f"DoF Pos {joint}" for joint in _JOINT_TITLES),
            *(f"DoF Vel {joint}" for joint in _JOINT_TITLES),
            *(f"Prev Action {joint}" for joint in _JOINT_TITLES),
            *(f"{STATE_ENTRY}{i}" for i in range(self.n_machine_states)),
            "RM Iters",
            "Command RM Iters",
            *(f"Base Lin Vel {axis}" for axis in "XYZ"),
            *(f"Foot Height {leg}" for leg in robot.LEGS),
        )

    @property
    def size(self) -> int:
        """Length of the observation."""
        return len(self.names)

    @property
    def n_proprioceptive(self) -> int:
        """Length of the part that needs no estimator."""
        return self.size - N_ESTIMATED


def unit_of(name: str) -> str:
    """Returns the unit of an entry, with the factor that it is scaled by.

    Raises:
        KeyError: if no entry is called so.
    """
    for start, unit in _UNITS.items():
        if name.startswith(start):
            return unit
    raise KeyError(name)


def machine_state_entries(names: tuple[str, ...]) -> slice:
    """Finds the one-hot machine state among the names of an observation."""
    start = names.index(f"{STATE_ENTRY}0")
    return slice(start, start + sum(name.startswith(STATE_ENTRY) for name in names))


def proprioception(
    command: Array,
    joint_position: Array,
    joint_velocity: Array,
    previous_action: Array,
    rm_state: Array,
    rm_iterations: Array,
    commanded_dwell: Array,
    joint_noise: Array | float = 0.0,
) -> Array:
    """Assembles the part of the observation that needs no estimator.

    Args:
        command: Forward speed and yaw rate (..., 2; m/s, rad/s).
        joint_position: Joint positions (..., 12; rad).
        joint_velocity: Joint velocities (..., 12; rad/s).
        previous_action: Action of the previous control step (..., 12).
        rm_state: One-hot state of the reward machine (..., n_states).
        rm_iterations: Control steps spent in that state (...).
        commanded_dwell: Commanded iterations (...; control steps).
        joint_noise: Noise on positions, then velocities (..., 24; rad, rad/s).

    Returns:
        Proprioception (..., 40 + n_states), in the order of `ObservationLayout`.
    """
    measured = np.concatenate([joint_position, joint_velocity], axis=-1) + joint_noise
    counts = np.stack([rm_iterations, commanded_dwell], axis=-1)
    return np.concatenate(
        [
            command,
            measured[..., : robot.N_JOINTS] - robot.DEFAULT_STANCE,
            measured[..., robot.N_JOINTS :] * JOINT_VELOCITY_SCALE,
            previous_action,
            rm_state,
            counts * ITERATIONS_SCALE,
        ],
        axis=-1,
    )


def body_state(state: Array) -> Array:
    """Returns the true values of what the estimator estimates.

    Args:
        state: The plant's state x (..., 37).

    Returns:
        Base linear velocity in the trunk's frame, scaled by 2, and foot heights (..., 7; m/s, m).
    """
    linear, _ = kinematics.base_velocity(state)
    heights = kinematics.foot_heights(state)
    return np.concatenate([BASE_VELOCITY_SCALE * linear, heights], axis=-1)
