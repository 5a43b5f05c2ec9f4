"""Controllers as files: each compares itself with Python, and writes itself."""

import tempfile
from abc import ABC, abstractmethod
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path

import pandas as pd

from glassgait.models.export.binding import LoadedController
from glassgait.models.export.controller import write_controller
from glassgait.models.export.language import Real
from glassgait.models.export.reference import PythonController
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.task import EPISODE_STEPS
from glassgait.models.task.gait import Gait
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.studies.common.console import say
from glassgait.studies.deployment.export.agreement import (
    compare_controllers,
    random_sequences,
    recorded_sequences,
)
from glassgait.studies.deployment.export.closed_loop import Maker, by_controller, walk_both
from glassgait.studies.deployment.export.compiler import has_compiler, load_controller, write_source


@dataclass(frozen=True)
class Deployment:
    """What is exported.

    Attributes:
        gait: The gait, whose reward machine runs, or several that change on request.
        controller: One policy alone, of several gaits a `SwitchedPolicy`.
        name: What the names of files begin with.
        policy_name: What the policy is called.
    """

    gait: Gait | GaitSwitch
    controller: AlternatingController
    name: str
    policy_name: str


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
    """

    title: str

    def __init__(self, deployment: Deployment) -> None:
        self.deployment = deployment

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
        Args:
            deployment: What is exported.
            real: The type to compute in.

        Raises:
            InputError: if there is no C for it.
        """
        super().__init__(deployment)
        self.written = write_controller(
            deployment.gait,
            deployment.controller,
            name=deployment.name,
            policy_name=deployment.policy_name,
            version=version("glassgait"),
            real=real,
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
        recorded, seed = effort.n_recorded, effort.seed
        sequences = {
            "recorded": recorded_sequences(gait, controller, recorded, seed),
            "random": random_sequences(controller.robot, gait, effort.n_steps - recorded, seed),
        }
        python = PythonController(gait, controller)
        rows = [
            {"sensors": name, **asdict(compare_controllers(python, compiled, own))}
            for name, own in sequences.items()
        ]
        return pd.DataFrame(rows).dropna(axis="columns")
