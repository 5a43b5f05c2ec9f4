"""A compiled controller, called from Python."""

import ctypes
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.export.controller import INITIALISED, ControllerSource
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task.command import Command
from glassgait.models.task.ground import LEVEL_GROUND, Ground

OK, BAD_INPUT, BAD_TARGET, COMMAND_LIMITED, NOT_INITIALISED, BAD_MEMORY = 0, 1, 2, 4, 8, 16
"""What a step returns: the sum of what happened."""

NO_GAIT = -1
"""A request for no gait, which every controller of several refuses as bad input."""

N_MEMORY = quadruped.N_JOINTS + 2 * quadruped.N_LEGS + 3
"""Numbers that a controller remembers from one step to the next."""

ACTION = slice(0, quadruped.N_JOINTS)
FOOT_HEIGHT = slice(ACTION.stop, ACTION.stop + quadruped.N_LEGS)
TOUCHED = slice(FOOT_HEIGHT.stop, FOOT_HEIGHT.stop + quadruped.N_LEGS)
MACHINE = slice(TOUCHED.stop, N_MEMORY)
"""Where its parts stand among them, as `Step` has it."""


class Step(NamedTuple):
    """What a step of a controller brings.

    Attributes:
        memory: What it remembers (23): the action (12), estimated foot heights (4; m), which feet
            touch (4), and the machine's state, iterations and age. States of several gaits are
            counted as `GaitSwitch` counts them, those of the first gait first.
        targets: Joint position targets (12; rad).
        status: 0, or the sum of `BAD_INPUT`, `BAD_TARGET`, `COMMAND_LIMITED` and `BAD_MEMORY`.
    """

    memory: Array
    targets: Array
    status: int


@dataclass(frozen=True)
class Sensors:
    """What a controller reads.

    Attributes:
        joint_position: Joint positions (12; rad).
        joint_velocity: Joint velocities (12; rad/s).
        touching: Whether each foot presses on the ground (4).
    """

    joint_position: Array
    joint_velocity: Array
    touching: NDArray[np.bool_]


def sensed(robot: Robot, state: Array, ground: Ground = LEVEL_GROUND) -> Sensors:
    """Returns what a robot senses without noise, in a state x (37) of the plant."""
    return Sensors(
        state[quadruped.JOINT_POSITION],
        state[quadruped.JOINT_VELOCITY],
        ground.touching(robot, state),
    )


class LoadedController:
    """Calls a controller's C functions; it has no memory of its own.

    Attributes:
        name: Its name.
        n_gaits: Number of its gaits; of several, one is requested at each step.
        limits_targets: Whether its targets stay within the joints' ranges.
    """

    def __init__(self, path: Path, written: ControllerSource) -> None:
        """
        Args:
            path: The shared library that its C file was compiled to.
            written: What was compiled.

        Raises:
            InputError: if there is no such library, or it holds another controller.
        """
        real: Any = ctypes.c_double if written.real == "double" else ctypes.c_float
        joints = real * quadruped.N_JOINTS
        feet, flags = real * quadruped.N_LEGS, ctypes.c_int * quadruped.N_LEGS
        number = ctypes.c_int
        self.n_gaits = len(written.n_states)
        self.limits_targets = written.limits_targets
        self._first_states = np.cumsum([0, *written.n_states[:-1]])
        several: dict[str, Any] = {"gait": number} if self.n_gaits > 1 else {}
        self._memory = _struct(
            initialised=ctypes.c_uint,
            action=joints,
            foot_height=feet,
            touched=flags,
            **several,
            state=number,
            iterations=number,
            age=number,
        )
        self._sensors = _struct(joint_position=joints, joint_velocity=joints, foot_contact=flags)
        self._command = _struct(speed=real, yaw_rate=real, dwell=real, **several)
        self._targets = _struct(joint_position=joints)
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
        """Returns what a controller remembers before its first step (23)."""
        memory = self._memory()
        self._init(ctypes.byref(memory))
        return self._packed(memory)

    def gait_of(self, memory: Array) -> int:
        """Returns the number of the gait that runs, of what a controller remembers (23)."""
        state = memory[MACHINE][0]
        return int(np.searchsorted(self._first_states, state, side="right")) - 1

    def step(self, memory: Array, sensors: Sensors, command: Command, requested: int = 0) -> Step:
        """Takes one step.

        Args:
            memory: What it remembers of the step before (23).
            sensors: What the robot senses now.
            command: Velocities (2; m/s, rad/s) and dwell (control steps) that are commanded.
            requested: Number of the gait that is to run, of several.
        """
        own, targets = self._unpacked(memory), self._targets()
        sensed = self._sensors(
            tuple(sensors.joint_position),
            tuple(sensors.joint_velocity),
            tuple(int(touches) for touches in sensors.touching),
        )
        request = (requested,) if self.n_gaits > 1 else ()
        commanded = self._command(*command.velocity, float(command.dwell), *request)
        status = self._step(*map(ctypes.byref, (own, sensed, commanded, targets)))
        return Step(self._packed(own), np.array(targets.joint_position, dtype=float), status)

    def _unpacked(self, memory: Array) -> ctypes.Structure:
        state, iterations, age = memory[MACHINE].astype(int).tolist()
        gait = self.gait_of(memory)
        running = (gait,) if self.n_gaits > 1 else ()
        return self._memory(
            INITIALISED,
            tuple(memory[ACTION]),
            tuple(memory[FOOT_HEIGHT]),
            tuple(memory[TOUCHED].astype(int).tolist()),
            *running,
            state - int(self._first_states[gait]),
            iterations,
            age,
        )

    def _packed(self, memory: Any) -> Array:
        parts = (memory.action, memory.foot_height, memory.touched)
        first = self._first_states[memory.gait] if self.n_gaits > 1 else 0
        machine = (first + memory.state, memory.iterations, memory.age)
        return np.array([*(value for part in parts for value in part), *machine], dtype=float)


def _struct(**fields: Any) -> type[ctypes.Structure]:
    return type("Struct", (ctypes.Structure,), {"_fields_": list(fields.items())})
