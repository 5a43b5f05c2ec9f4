"""A compiled controller, called from Python."""

import ctypes
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.export.controller import INITIALISED, Interface
from glassgait.models.robots import quadruped
from glassgait.models.task.command import Command
from glassgait.models.task.imu import ImuReading
from glassgait.models.task.odometry import OdometryState

OK, BAD_INPUT, BAD_TARGET, COMMAND_LIMITED, NOT_INITIALISED, BAD_MEMORY = 0, 1, 2, 4, 8, 16
"""What a step returns: the sum of what happened."""

NO_NUMBER = -1
"""A request for no gait, or no mode, which every controller that has several refuses as bad
input."""

N_MEMORY = quadruped.N_JOINTS + 3 * quadruped.N_LEGS + 3
"""Numbers that a controller remembers from one step to the next, but for odometry."""

N_ODOMETRY = 1 + 3 + 4 * quadruped.N_LEGS + 3
"""Numbers that its odometry remembers: whether it has begun, then an `OdometryState`."""

ACTION = slice(0, quadruped.N_JOINTS)
FOOT_HEIGHT = slice(ACTION.stop, ACTION.stop + quadruped.N_LEGS)
READING = slice(FOOT_HEIGHT.stop, FOOT_HEIGHT.stop + quadruped.N_LEGS)
UNCHANGED = slice(READING.stop, READING.stop + quadruped.N_LEGS)
MACHINE = slice(UNCHANGED.stop, N_MEMORY)
ODOMETRY = slice(N_MEMORY, N_MEMORY + N_ODOMETRY)
"""Where its parts stand among them, as `Step` has it."""

N_DAY = 4 + quadruped.N_JOINTS
"""Numbers that a day remembers, a `ModeState`; they are the last."""


class Step(NamedTuple):
    """What a step of a controller brings.

    Attributes:
        memory: What it remembers (27, or 50): the action (12), estimated foot heights (4; m), what
            the contact sensors read (4; -1 before the first step), for how many steps they have not
            changed (4), and the machine's state, iterations and age. States of several gaits are
            counted as `GaitSwitch` counts them, those of the first gait first. With odometry,
            whether it has begun, its velocity (3; m/s), footholds (12; m), which feet touch (4) and
            how the trunk turns (3; rad/s). With a day, its `ModeState` (16).
        targets: Joint position targets (12; rad).
        status: 0, or the sum of `BAD_INPUT`, `BAD_TARGET`, `COMMAND_LIMITED` and `BAD_MEMORY`.
        damped: Of a day, whether joints are to be damped alone.
    """

    memory: Array
    targets: Array
    status: int
    damped: bool = False


@dataclass(frozen=True)
class Sensors:
    """What a controller reads.

    Attributes:
        joint_position: Joint positions (12; rad).
        joint_velocity: Joint velocities (12; rad/s).
        touching: Whether each foot presses on the ground (4).
        imu: The IMU's reading (9); only controllers that have an IMU read it.
    """

    joint_position: Array
    joint_velocity: Array
    touching: NDArray[np.bool_]
    imu: Array | None = None


def unpacked_odometry(memory: Array) -> tuple[bool, OdometryState]:
    """Returns whether odometry has begun, and its state, of what it remembers (23)."""
    begun, velocity, footholds, touching, turning = np.split(
        memory, [1, 4, 4 + 3 * quadruped.N_LEGS, 4 + 4 * quadruped.N_LEGS]
    )
    state = OdometryState(velocity, footholds.reshape(-1, 3), touching > 0.5, turning)
    return bool(begun[0]), state


class LoadedController:
    """Calls a controller's C functions; it has no memory of its own.

    Attributes:
        name: Its name.
        n_gaits: Number of its gaits; of several, one is requested at each step.
        has_imu: Whether it reads an IMU.
        has_day: Whether it lives through a day, of which a mode is requested at each step.
        joint_law: How joints are to follow its targets, which it limits itself if they are to.
    """

    def __init__(self, path: Path, written: Interface) -> None:
        """
        Args:
            path: The shared library that its C file was compiled to.
            written: How what was compiled is called.

        Raises:
            InputError: if there is no such library, or it holds another controller.
        """
        real: Any = ctypes.c_double if written.real == "double" else ctypes.c_float
        joints = real * quadruped.N_JOINTS
        feet, flags = real * quadruped.N_LEGS, ctypes.c_int * quadruped.N_LEGS
        number = ctypes.c_int
        self.n_gaits = len(written.n_states)
        self.has_imu, self._has_odometry = written.has_imu, written.has_odometry
        self.has_day = written.has_day
        self.joint_law = written.joint_law
        self._first_states = np.cumsum([0, *written.n_states[:-1]])
        several: dict[str, Any] = {"gait": number} if self.n_gaits > 1 else {}
        self._memory = _struct(
            initialised=ctypes.c_uint,
            action=joints,
            foot_height=feet,
            reading=flags,
            unchanged=flags,
            **several,
            state=number,
            iterations=number,
            age=number,
            **(_odometry_fields(real) if self._has_odometry else {}),
            **(_day_fields(real) if self.has_day else {}),
        )
        parts = dict.fromkeys(ImuReading._fields, real * 3) if written.has_imu else {}
        self._sensors = _struct(
            joint_position=joints, joint_velocity=joints, foot_contact=flags, **parts
        )
        request = {"request": number} if self.has_day else {}
        self._command = _struct(speed=real, yaw_rate=real, dwell=real, **several, **request)
        self._targets = _struct(
            joint_position=joints, **({"damped": number} if self.has_day else {})
        )
        self.name = written.name
        try:
            library = ctypes.CDLL(str(path.resolve()))
            self._init = getattr(library, f"{written.name}_init")
            self._step = getattr(library, f"{written.name}_step")
        except (OSError, AttributeError) as error:
            raise InputError(
                f"{path}: is no controller {written.name!r}; compile it anew"
            ) from error
        self._init.restype = None

    def initial(self) -> Array:
        """Returns what a controller remembers before its first step (27, or 50)."""
        memory = self._memory()
        self._init(ctypes.byref(memory))
        return self._packed(memory)

    def gait_of(self, memory: Array) -> int:
        """Returns the number of the gait that runs, of what a controller remembers."""
        state = memory[MACHINE][0]
        return int(np.searchsorted(self._first_states, state, side="right")) - 1

    def mode_of(self, memory: Array) -> int:
        """Returns the number of the day's mode, of what a controller with a day remembers."""
        return int(memory[-N_DAY])

    def step(
        self,
        memory: Array,
        sensors: Sensors,
        command: Command,
        requested: int = 0,
        requested_mode: int = 0,
    ) -> Step:
        """Takes one step.

        Args:
            memory: What it remembers of the step before.
            sensors: What the robot senses now.
            command: Velocities (2; m/s, rad/s) and dwell (control steps) that are commanded.
            requested: Number of the gait that is to run, of several.
            requested_mode: Number of what the operator requests, of a day.

        Raises:
            ValueError: if it reads an IMU and the robot has none.
        """
        own, targets = self._unpacked(memory), self._targets()
        sensed = self._sensors(
            tuple(sensors.joint_position),
            tuple(sensors.joint_velocity),
            tuple(int(touches) for touches in sensors.touching),
            *self._readings(sensors),
        )
        request = (requested,) if self.n_gaits > 1 else ()
        request += (requested_mode,) if self.has_day else ()
        commanded = self._command(*command.velocity, float(command.dwell), *request)
        status = self._step(*map(ctypes.byref, (own, sensed, commanded, targets)))
        found = np.array(targets.joint_position, dtype=float)
        return Step(self._packed(own), found, status, bool(self.has_day and targets.damped))

    def _readings(self, sensors: Sensors) -> tuple[tuple[float, ...], ...]:
        if not self.has_imu:
            return ()
        if sensors.imu is None:
            raise ValueError(f"controller {self.name}: it reads an IMU; give its reading")
        return tuple(tuple(part) for part in ImuReading.of(sensors.imu))

    def _unpacked(self, memory: Array) -> ctypes.Structure:
        state, iterations, age = memory[MACHINE].astype(int).tolist()
        gait = self.gait_of(memory)
        running = (gait,) if self.n_gaits > 1 else ()
        return self._memory(
            INITIALISED,
            tuple(memory[ACTION]),
            tuple(memory[FOOT_HEIGHT]),
            *(tuple(memory[part].astype(int).tolist()) for part in (READING, UNCHANGED)),
            *running,
            state - int(self._first_states[gait]),
            iterations,
            age,
            *(self._odometry_memory(memory) if self._has_odometry else ()),
            *(_day_memory(memory[-N_DAY:]) if self.has_day else ()),
        )

    def _odometry_memory(self, memory: Array) -> tuple[Any, ...]:
        begun, (velocity, footholds, touching, turning) = unpacked_odometry(memory[ODOMETRY])
        feet = tuple(map(tuple, footholds))
        touched = tuple(touching.astype(int).tolist())
        return int(begun), tuple(velocity), feet, touched, tuple(turning)

    def _packed(self, memory: Any) -> Array:
        feet = (memory.foot_height, memory.reading, memory.unchanged)
        first = self._first_states[memory.gait] if self.n_gaits > 1 else 0
        machine = (first + memory.state, memory.iterations, memory.age)
        whole = [*memory.action, *(value for part in feet for value in part), *machine]
        if self._has_odometry:
            feet = (value for foot in memory.footholds for value in foot)
            whole += [memory.begun, *memory.velocity, *feet, *memory.touching, *memory.turning]
        if self.has_day:
            counts = (memory.mode, memory.mode_steps, memory.idle, memory.unsound)
            whole += [*counts, *memory.begin]
        return np.array(whole, dtype=float)


def _odometry_fields(real: Any) -> dict[str, Any]:
    """Returns the fields of what odometry remembers, as `ODOMETRY` has them."""
    feet = (real * 3) * quadruped.N_LEGS
    flags = ctypes.c_int * quadruped.N_LEGS
    return {
        "begun": ctypes.c_int,
        "velocity": real * 3,
        "footholds": feet,
        "touching": flags,
        "turning": real * 3,
    }


def _day_fields(real: Any) -> dict[str, Any]:
    """Returns the fields of what a day remembers, as a `ModeState` has them."""
    counts = dict.fromkeys(("mode", "mode_steps", "idle", "unsound"), ctypes.c_int)
    return {**counts, "begin": real * quadruped.N_JOINTS}


def _day_memory(memory: Array) -> tuple[Any, ...]:
    *counts, begin = np.split(memory, [1, 2, 3, 4])
    return (*(int(count[0]) for count in counts), tuple(begin))


def _struct(**fields: Any) -> type[ctypes.Structure]:
    return type("Struct", (ctypes.Structure,), {"_fields_": list(fields.items())})
