"""A whole controller as one C file, compared with Python by the system's compiler."""

import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path

import pandas as pd

from glassgait.models.export.binding import LoadedController
from glassgait.models.export.controller import ControllerSource, write_controller
from glassgait.models.export.language import Real
from glassgait.models.export.reference import PythonController
from glassgait.studies.common.console import say
from glassgait.studies.deployment.export.agreement import (
    Moment,
    compare_controllers,
    random_sequences,
    recorded_sequences,
)
from glassgait.studies.deployment.export.closed_loop import by_controller
from glassgait.studies.deployment.export.compiler import has_compiler, load_controller, write_source
from glassgait.studies.deployment.export.exported import Acting, Effort, ExportedPolicy


class CFile(ExportedPolicy):
    """A controller in C, from sensors to joint targets."""

    title = "C"

    def __init__(self, acting: Acting, real: Real) -> None:
        """
        Args:
            acting: What is exported.
            real: The type to compute in.

        Raises:
            InputError: if there is no C for it.
        """
        super().__init__(acting)
        self.written = write_controller(
            acting.gait,
            acting.policy,
            acting.expert,
            name=acting.name,
            policy_name=acting.policy_name,
            version=version("glassgait"),
            real=real,
        )

    def check(self, effort: Effort) -> dict[str, pd.DataFrame]:
        with compiled_controller(self.written) as compiled:
            if compiled is None:
                return {}
            say(f"taking {effort.n_steps} steps, in Python and in C")
            agreement = self._agreement(compiled, effort)
            return {"agreement": agreement} | self._walked(by_controller(compiled), effort)

    def write(self, folder: Path) -> tuple[Path, ...]:
        source = write_source(self.written, folder)
        return source, source.with_suffix(".h")

    def _agreement(self, compiled: LoadedController, effort: Effort) -> pd.DataFrame:
        gait, policy, expert = self.acting.gait, self.acting.policy, self.acting.expert
        python = PythonController(gait, policy, expert)
        recorded = effort.n_recorded
        sequences = {
            "recorded": recorded_sequences(gait, policy, expert, recorded, effort.seed),
            "random": random_sequences(policy.robot, gait, effort.n_steps - recorded, effort.seed),
        }
        return agreement_table(python, compiled, sequences)


@contextmanager
def compiled_controller(written: ControllerSource) -> Iterator[LoadedController | None]:
    """Compiles a controller for a while; where there is no compiler it says so, and yields None."""
    if not has_compiler():
        say("there is no C compiler here, cc: the file was not compared with Python")
        yield None
        return
    with tempfile.TemporaryDirectory() as temporary:
        yield load_controller(written, Path(temporary))


def agreement_table(
    python: PythonController,
    compiled: LoadedController,
    sequences: Mapping[str, list[list[Moment]]],
) -> pd.DataFrame:
    """Compares controllers over sequences from several sources, by their names: a row each."""
    rows = [
        {"sensors": name, **asdict(compare_controllers(python, compiled, own))}
        for name, own in sequences.items()
    ]
    return pd.DataFrame(rows).dropna(axis="columns")
