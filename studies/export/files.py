"""Controllers as files: each compares itself with Python, and writes itself; C is compiled here."""

import shutil
import subprocess
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path

import pandas as pd

from glassgait.models.errors import InputError, brief
from glassgait.models.export.binding import LoadedController
from glassgait.models.export.contract import CONTRACT, Contract, contract_of, read_contract
from glassgait.models.export.controller import ControllerSource, Interface, write_controller
from glassgait.models.export.language import Real
from glassgait.models.export.reference import PythonController
from glassgait.models.files import write_atomically
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.robots.robot import Robot
from glassgait.models.task import EPISODE_STEPS
from glassgait.models.task.day import Day
from glassgait.models.task.gait import Gait
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.studies.common.console import say
from glassgait.studies.export.agreement import (
    compare_controllers,
    random_sequences,
    recorded_sequences,
    with_requested_modes,
)
from glassgait.studies.export.closed_loop import Maker, by_controller, walk_both

COMPILER = "cc"

FLAGS = ("-O2", "-Wall", "-Wextra", "-Werror", "-std=c99", "-ffp-contract=off")
"""How a controller's file is compiled, without a warning."""


SAME = 1e-6
"""Difference of a joint target (rad) up to which C in double precision is the same controller."""


@dataclass(frozen=True)
class Deployment:
    """What is exported.

    Attributes:
        gait: The gait, whose reward machine runs, or several that change on request.
        controller: One policy alone, of several gaits a `SwitchedPolicy`.
        name: What the names of files begin with.
        policy_name: What the policy is called.
        day: The robot's day; none where the policy always acts.
    """

    gait: Gait | GaitSwitch
    controller: AlternatingController
    name: str
    policy_name: str
    day: Day | None = None


@dataclass(frozen=True)
class Effort:
    """How much an export is compared with Python.

    Attributes:
        n_steps: Control steps, half of recorded and half of random sensors.
        n_robots: Robots that walk for 20 s in each engine; none if 0.
        seed: Seed of all randomness.
    """

    n_steps: int
    n_robots: int
    seed: int

    @property
    def n_recorded(self) -> int:
        """Control steps of recorded sensors."""
        return (self.n_steps + 1) // 2


class Exported(ABC):
    """A controller in another language.

    Attributes:
        title: Name of the language.
        deployment: What is exported.
        real: Type that it computes in, or that it reads and gives.
    """

    title: str

    def __init__(self, deployment: Deployment, real: Real) -> None:
        self.deployment = deployment
        self.real: Real = real

    @abstractmethod
    def check(self, effort: Effort) -> dict[str, pd.DataFrame]:
        """Compares itself with Python.

        Returns:
            Tables by their names: `agreement`, and `closed_loop` if robots walk.

        Raises:
            InputError: if it is not the same policy.
        """

    @abstractmethod
    def write(self, folder: Path) -> tuple[Path, ...]:
        """Writes its files, each of them whole or not at all, and returns their paths.

        Raises:
            InputError: if they cannot be written.
        """

    def write_all(self, folder: Path) -> tuple[Path, ...]:
        """Writes its files and the contract beside them, and returns their paths.

        Raises:
            InputError: if they cannot be written.
        """
        first, *others = self.write(folder)
        own = self.deployment
        contract = contract_of(own.gait, own.controller, first, own.policy_name, own.day, self.real)
        write_atomically(folder / CONTRACT, contract.text())
        return first, *others, folder / CONTRACT

    def _walked(self, exported: Maker, effort: Effort) -> dict[str, pd.DataFrame]:
        """Lets robots walk, if any are to."""
        if not effort.n_robots:
            return {}
        say(f"robots that walk, moved by Python and by {self.title}: {effort.n_robots}")
        table = walk_both(
            self.deployment.gait,
            self.deployment.controller,
            exported,
            title=self.title,
            n_robots=effort.n_robots,
            n_steps=EPISODE_STEPS,
            seed=effort.seed,
        )
        return {"closed_loop": table}


class CFile(Exported):
    """A whole controller in C, from sensors to joint targets; the system's compiler compiles it."""

    title = "C"

    def __init__(self, deployment: Deployment, real: Real) -> None:
        """
        Raises:
            InputError: if there is no C for it.
        """
        super().__init__(deployment, real)
        self.written = write_controller(
            deployment.gait,
            deployment.controller,
            name=deployment.name,
            policy_name=deployment.policy_name,
            version=version("glassgait"),
            real=real,
            day=deployment.day,
        )

    def check(self, effort: Effort) -> dict[str, pd.DataFrame]:
        if not has_compiler():
            say("there is no C compiler here, cc: the file was not compared with Python")
            return {}
        with tempfile.TemporaryDirectory() as temporary:
            compiled = load_controller(self.written, Path(temporary))
            say(f"taking {effort.n_steps} steps, in Python and in C")
            agreement = self._agreement(compiled, effort)
            return {"agreement": agreement} | self._walked(by_controller(compiled), effort)

    def write(self, folder: Path) -> tuple[Path, ...]:
        source = write_source(self.written, folder)
        return source, source.with_suffix(".h")

    def _agreement(self, compiled: LoadedController, effort: Effort) -> pd.DataFrame:
        """Compares both over recorded and over random sequences: a row each."""
        gait, controller = self.deployment.gait, self.deployment.controller
        day, recorded, seed = self.deployment.day, effort.n_recorded, effort.seed
        drawn = random_sequences(controller.robot, gait, effort.n_steps - recorded, seed)
        sequences = {
            "recorded": recorded_sequences(gait, controller, recorded, seed),
            "random": drawn if day is None else with_requested_modes(drawn, seed),
        }
        python = PythonController(gait, controller, day)
        found = {
            name: compare_controllers(python, compiled, own) for name, own in sequences.items()
        }
        for own in found.values():
            if self.real == "double" and (own.target > SAME or own.machine):
                raise InputError(
                    f"export: a joint target of C differs from Python's by {own.target:.2g} rad, "
                    f"and the machine at {own.machine} of {own.steps} steps; where the policy asks "
                    "for what is not finite, or beyond 1e6, C stands still: give formulas that "
                    "do not"
                )
        rows = [{"sensors": name, **asdict(own)} for name, own in found.items()]
        return pd.DataFrame(rows).dropna(axis="columns")


def has_compiler() -> bool:
    """Returns whether the system has a C compiler."""
    return shutil.which(COMPILER) is not None


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


def compile_c(source: Path, output: Path, flags: Sequence[str] = FLAGS) -> None:
    """Compiles a C file.

    Raises:
        InputError: if there is no compiler, or it refuses the file.
    """
    if not has_compiler():
        raise InputError(f"there is no C compiler {COMPILER!r}; install one, such as gcc")
    command = [COMPILER, *flags, str(source), "-o", str(output), "-lm"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise InputError(f"{source}: cannot be compiled ({brief(done.stderr)}); mend it")


def load_controller(written: ControllerSource, folder: Path) -> LoadedController:
    """Writes a controller's files into a folder, compiles them there and loads what comes out.

    Raises:
        InputError: if one of these fails.
    """
    return _loaded(write_source(written, folder), written, folder)


def load_contract(
    path: Path, folder: Path, robot: Robot | None = None
) -> tuple[Contract, LoadedController, Robot]:
    """Reads a contract, compiles the C file beside it into a folder and loads what comes out.

    Args:
        path: A `deploy.yaml`.
        folder: Where the compiled file goes.
        robot: The robot that is to be moved; by default the one of its name, which must ship.

    Raises:
        InputError: if the contract, the robot or the file are not each other's, the file is no C,
            or it cannot be compiled.
    """
    contract, file, robot = read_contract(path, robot)
    return contract, _loaded(file, contract.interface(), folder), robot


def _loaded(source: Path, interface: Interface, folder: Path) -> LoadedController:
    """Compiles a controller's C file into a folder, and loads it."""
    library = folder / f"{source.stem}.so"
    compile_c(source, library, (*FLAGS, "-shared", "-fPIC"))
    return LoadedController(library, interface)
