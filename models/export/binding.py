"""Exported controllers, compiled with the system's C compiler and called from Python."""

import ctypes
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.control import Sensors
from glassgait.models.errors import InputError, brief
from glassgait.models.estimation.imu import ImuReading
from glassgait.models.estimation.odometry import OdometryState
from glassgait.models.export.c_source import INITIALISED, ControllerSource, Interface
from glassgait.models.files import write_atomically
from glassgait.models.robots import quadruped
from glassgait.models.task.command import Command

COMPILER = "cc"

FLAGS = ("-O2", "-Wall", "-Wextra", "-Werror", "-std=c99", "-ffp-contract=off")
"""Flags by which a controller's file compiles without a warning."""

OK, BAD_INPUT, BAD_TARGET, COMMAND_LIMITED, NOT_INITIALISED, BAD_MEMORY = 0, 1, 2, 4, 8, 16
"""Flags that a step returns, added up."""

N_MEMORY = quadruped.N_JOINTS + 3 * quadruped.N_LEGS + 3
"""Numbers that a controller remembers from one step to the next, besides its odometry's."""

N_ODOMETRY = 1 + 3 + 4 * quadruped.N_LEGS + 3
"""Numbers that its odometry remembers: whether it has begun, then an `OdometryState`."""

ACTION = slice(0, quadruped.N_JOINTS)
FOOT_HEIGHT = slice(ACTION.stop, ACTION.stop + quadruped.N_LEGS)
READING = slice(FOOT_HEIGHT.stop, FOOT_HEIGHT.stop + quadruped.N_LEGS)
UNCHANGED = slice(READING.stop, READING.stop + quadruped.N_LEGS)
MACHINE = slice(UNCHANGED.stop, N_MEMORY)
ODOMETRY = slice(N_MEMORY, N_MEMORY + N_ODOMETRY)
"""Slices of the parts of a controller's memory; see `Step`."""


class Step(NamedTuple):
    """The result of a step of a controller.

    Attributes:
        memory: Its memory (27, or 50): the action (12), estimated foot heights (4; m), readings of
            the contact sensors (4; -1 before the first step), the number of steps for which they
            have not changed (4), and the machine's state, iterations and age. With odometry,
            whether it has begun, its velocity (3; m/s), footholds (12; m), which feet touch (4) and
            the angular velocity of the trunk (3; rad/s).
        targets: Joint position targets (12; rad).
        status: 0, or the sum of `BAD_INPUT`, `BAD_TARGET`, `COMMAND_LIMITED` and `BAD_MEMORY`.
    """

    memory: Array
    targets: Array
    status: int


def unpacked_odometry(memory: Array) -> tuple[bool, OdometryState]:
    """Returns whether odometry has begun, and its state, of its memory (23)."""
    begun, velocity, footholds, touching, turning = np.split(
        memory, [1, 4, 4 + 3 * quadruped.N_LEGS, 4 + 4 * quadruped.N_LEGS]
    )
    state = OdometryState(velocity, footholds.reshape(-1, 3), touching > 0.5, turning)
    return bool(begun[0]), state


class LoadedController:
    """Calls a controller's C functions; the caller keeps its memory.

    Attributes:
        name: Its name.
        has_imu: Whether it reads an IMU.
        joint_law: How joints are to follow its targets.
    """

    def __init__(self, path: Path, interface: Interface) -> None:
        """
        Args:
            path: The shared library that its C file was compiled to.
            interface: The interface of that file.

        Raises:
            InputError: if the library is missing, or holds another controller.
        """
        self.name, self.joint_law = interface.name, interface.joint_law
        self.has_imu, self._has_odometry = interface.has_imu, interface.has_odometry
        self._declare(ctypes.c_double if interface.real == "double" else ctypes.c_float)
        try:
            library = ctypes.CDLL(str(path.resolve()))
            self._init = getattr(library, f"{self.name}_init")
            self._step = getattr(library, f"{self.name}_step")
        except (OSError, AttributeError) as error:
            raise InputError(f"{path}: is no controller {self.name!r}; compile it anew") from error
        self._init.restype = None

    def _declare(self, real: Any) -> None:
        """Declares the structs of the header."""
        joints, axes = real * quadruped.N_JOINTS, real * 3
        feet, flags = real * quadruped.N_LEGS, ctypes.c_int * quadruped.N_LEGS
        counts = dict.fromkeys(("state", "iterations", "age"), ctypes.c_int)
        odometry = {
            "begun": ctypes.c_int,
            "velocity": axes,
            "footholds": axes * quadruped.N_LEGS,
            "touching": flags,
            "turning": axes,
        }
        self._memory = _struct(
            initialised=ctypes.c_uint,
            action=joints,
            foot_height=feet,
            reading=flags,
            unchanged=flags,
            **counts,
            **(odometry if self._has_odometry else {}),
        )
        self._sensors = _struct(
            joint_position=joints,
            joint_velocity=joints,
            foot_contact=flags,
            **(dict.fromkeys(ImuReading._fields, axes) if self.has_imu else {}),
        )
        self._command = _struct(speed=real, yaw_rate=real, dwell=real)
        self._targets = _struct(joint_position=joints)

    def initial(self) -> Array:
        """Returns the memory of a controller before its first step (27, or 50)."""
        memory = self._memory()
        self._init(ctypes.byref(memory))
        return self._packed(memory)

    def step(self, memory: Array, sensors: Sensors, command: Command) -> Step:
        """Takes one step.

        Args:
            memory: The memory after the step before.
            sensors: The present readings.
            command: Velocities (2; m/s, rad/s) and dwell (control steps) that are commanded.
        """
        after, targets = self._unpacked(memory), self._targets()
        sensed = self._sensors(
            tuple(sensors.joint_position),
            tuple(sensors.joint_velocity),
            tuple(int(touches) for touches in sensors.touching),
            *self._imu_parts(sensors),
        )
        commanded = self._command(*command.velocity, float(command.dwell))
        status = self._step(*map(ctypes.byref, (after, sensed, commanded, targets)))
        return Step(self._packed(after), np.array(targets.joint_position, dtype=float), status)

    def _imu_parts(self, sensors: Sensors) -> tuple[tuple[float, ...], ...]:
        if not self.has_imu:
            return ()
        return tuple(tuple(part) for part in ImuReading.of(sensors.imu))

    def _unpacked(self, memory: Array) -> ctypes.Structure:
        return self._memory(
            INITIALISED,
            tuple(memory[ACTION]),
            tuple(memory[FOOT_HEIGHT]),
            *(tuple(memory[part].astype(int).tolist()) for part in (READING, UNCHANGED)),
            *memory[MACHINE].astype(int).tolist(),
            *(self._odometry_memory(memory) if self._has_odometry else ()),
        )

    def _odometry_memory(self, memory: Array) -> tuple[Any, ...]:
        begun, (velocity, footholds, touching, turning) = unpacked_odometry(memory[ODOMETRY])
        feet = tuple(map(tuple, footholds))
        touched = tuple(touching.astype(int).tolist())
        return int(begun), tuple(velocity), feet, touched, tuple(turning)

    def _packed(self, memory: Any) -> Array:
        feet = (memory.foot_height, memory.reading, memory.unchanged)
        machine = (memory.state, memory.iterations, memory.age)
        whole = [*memory.action, *(value for part in feet for value in part), *machine]
        if self._has_odometry:
            footholds = (value for foot in memory.footholds for value in foot)
            whole += [memory.begun, *memory.velocity, *footholds]
            whole += [*memory.touching, *memory.turning]
        return np.array(whole, dtype=float)


def _struct(**fields: Any) -> type[ctypes.Structure]:
    return type("Struct", (ctypes.Structure,), {"_fields_": list(fields.items())})


def has_compiler() -> bool:
    """Returns whether the system has a C compiler."""
    return shutil.which(COMPILER) is not None


def compile_c(source: Path, output: Path, flags: Sequence[str] = FLAGS) -> None:
    """Compiles a C file.

    Raises:
        InputError: if the compiler is missing, or refuses the file.
    """
    if not has_compiler():
        raise InputError(f"there is no C compiler {COMPILER!r}; install one, such as gcc")
    command = [COMPILER, *flags, str(source), "-o", str(output), "-lm"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise InputError(f"{source}: cannot be compiled ({brief(done.stderr)}); mend it")


def write_source(written: ControllerSource, folder: Path) -> Path:
    """Writes a controller's two files, the header first, and returns the C file's path.

    Raises:
        InputError: if they cannot be written there.
    """
    header, path = (folder / f"{written.name}.{end}" for end in "hc")
    write_atomically(header, written.header)
    try:
        write_atomically(path, written.source)
    except InputError:
        header.unlink(missing_ok=True)
        raise
    return path


def load_controller(written: ControllerSource, folder: Path) -> LoadedController:
    """Writes a controller's files into a folder, compiles them there and loads the library.

    Raises:
        InputError: if one of these fails.
    """
    return compiled_controller(write_source(written, folder), written, folder)


def compiled_controller(source: Path, interface: Interface, folder: Path) -> LoadedController:
    """Compiles a controller's C file into a folder, and loads the library.

    Raises:
        InputError: if one of these fails.
    """
    library = folder / f"{source.stem}.so"
    compile_c(source, library, (*FLAGS, "-shared", "-fPIC"))
    return LoadedController(library, interface)
