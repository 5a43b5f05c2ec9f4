"""Exported controllers, compiled with the system's C compiler and called from Python."""

import ctypes
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.control import Sensors
from glassgait.models.errors import InputError, brief
from glassgait.models.estimation.sensors import ImuReading
from glassgait.models.export.c_source import ControllerSource, Interface
from glassgait.models.files import write_atomically
from glassgait.models.robots import quadruped
from glassgait.models.task.command import Command

COMPILER = "cc"

FLAGS = ("-O2", "-Wall", "-Wextra", "-Werror", "-std=c99", "-ffp-contract=off")
"""Compiler flags; with these, a controller's file compiles without warnings."""

OK, BAD_INPUT, BAD_TARGET, COMMAND_LIMITED, NOT_INITIALISED, BAD_MEMORY = 0, 1, 2, 4, 8, 16
"""Flags of a step, whose sum is its status."""

Memory = NDArray[np.void]
"""A controller's memory: one record, with the fields of the header's struct."""


class Step(NamedTuple):
    memory: Memory
    targets: Array  # joint position targets (12; rad)
    status: int  # 0, or the sum of `BAD_INPUT`, `BAD_TARGET`, `COMMAND_LIMITED` and `BAD_MEMORY`


class LoadedController:
    """Calls the C functions of a controller in a shared library; the caller keeps its memory."""

    def __init__(self, path: Path, interface: Interface) -> None:
        self.name, self._has_imu = interface.name, interface.has_imu
        self._declare("f8" if interface.real == "double" else "f4", odometry=interface.has_odometry)
        try:
            library = ctypes.CDLL(str(path.resolve()))
            self._init = getattr(library, f"{self.name}_init")
            self._step = getattr(library, f"{self.name}_step")
        except (OSError, AttributeError) as error:
            raise InputError(f"{path}: is no controller {self.name!r}; compile it again") from error
        self._init.restype = None

    def _declare(self, real: str, *, odometry: bool) -> None:
        # Fields are in the order of controller.h; numpy aligns them as C does.
        joints, feet, axes = (quadruped.N_JOINTS,), (quadruped.N_LEGS,), (3,)
        self._sensors = _struct(
            ("joint_position", real, joints),
            ("joint_velocity", real, joints),
            ("foot_contact", "i4", feet),
            *((name, real, axes) for name in ImuReading._fields if self._has_imu),
        )
        self._command = _struct(("speed", real), ("yaw_rate", real), ("dwell", real))
        self._targets = _struct(("joint_position", real, joints))
        odometry_fields = (
            ("begun", "i4"),
            ("velocity", real, axes),
            ("footholds", real, feet + axes),
            ("touching", "i4", feet),
            ("turning", real, axes),
        )
        self._memory = _struct(
            ("initialised", "u4"),
            ("action", real, joints),
            ("foot_height", real, feet),
            ("reading", "i4", feet),
            ("unchanged", "i4", feet),
            *((name, "i4") for name in ("state", "iterations", "age")),
            *(odometry_fields if odometry else ()),
        )

    def initial(self) -> Memory:
        memory = np.zeros((), self._memory)
        self._init(_pointer(memory))
        return memory

    def step(self, memory: Memory, sensors: Sensors, command: Command) -> Step:
        """Takes one step of one robot, and leaves the given memory unchanged."""
        # Fill the structs of the header.
        sensed = np.zeros((), self._sensors)
        sensed["joint_position"] = sensors.joint_position
        sensed["joint_velocity"] = sensors.joint_velocity
        sensed["foot_contact"] = sensors.touching
        if self._has_imu:
            for name, value in ImuReading.of(sensors.imu)._asdict().items():
                sensed[name] = value
        commanded = np.array((*command.velocity, float(command.dwell)), self._command)

        # C changes the memory in place.
        after, targets = np.array(memory), np.zeros((), self._targets)
        status = self._step(*map(_pointer, (after, sensed, commanded, targets)))
        return Step(after, targets["joint_position"].astype(float), status)


def _struct(*fields: tuple[Any, ...]) -> np.dtype[np.void]:
    return np.dtype(list(fields), align=True)


def _pointer(record: Memory) -> ctypes.c_void_p:
    return record.ctypes.data_as(ctypes.c_void_p)


def has_compiler() -> bool:
    return shutil.which(COMPILER) is not None


def compile_c(source: Path, output: Path, flags: Sequence[str] = FLAGS) -> None:
    """Compiles a C file; raises InputError if the compiler is missing or fails."""
    if not has_compiler():
        raise InputError(f"there is no C compiler {COMPILER!r}; install one, such as gcc")
    command = [COMPILER, *flags, str(source), "-o", str(output), "-lm"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise InputError(f"{source}: cannot be compiled ({brief(done.stderr)}); correct it")


def write_source(written: ControllerSource, folder: Path) -> Path:
    """Writes a controller's two files, the header first, and returns the C file's path."""
    header, path = (folder / f"{written.name}.{end}" for end in "hc")
    write_atomically(header, written.header)
    write_atomically(path, written.source)
    return path


def load_controller(written: ControllerSource, folder: Path) -> LoadedController:
    return compiled_controller(write_source(written, folder), written, folder)


def compiled_controller(source: Path, interface: Interface, folder: Path) -> LoadedController:
    library = folder / f"{source.stem}.so"
    compile_c(source, library, (*FLAGS, "-shared", "-fPIC"))
    return LoadedController(library, interface)
