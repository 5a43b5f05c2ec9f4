"""A controller of several gaits as one C file, compared with Python by the system's compiler."""

from importlib.metadata import version
from pathlib import Path

import pandas as pd

from glassgait.models.export.language import Real
from glassgait.models.export.reference import PythonSwitchingController
from glassgait.models.export.switching_controller import write_switching_controller
from glassgait.models.policies.switched import SwitchedPolicy
from glassgait.models.task import EPISODE_STEPS
from glassgait.studies.common.console import say
from glassgait.studies.deployment.export.c_file import agreement_table, compiled_controller
from glassgait.studies.deployment.export.compiler import write_source
from glassgait.studies.deployment.export.exported import Effort, Exported
from glassgait.studies.deployment.export.switching_agreement import (
    random_switching_sequences,
    recorded_switching_sequences,
)
from glassgait.studies.deployment.export.switching_loop import change_both


class SwitchingCFile(Exported):
    """A controller of several gaits in C, from sensors to joint targets."""

    title = "C"

    def __init__(self, switched: SwitchedPolicy, name: str, policy_name: str, real: Real) -> None:
        """
        Args:
            switched: The gaits, and the policies that act and observe in each.
            name: What the names of files begin with.
            policy_name: What the policies are called.
            real: The type to compute in.

        Raises:
            InputError: if there is no C for one of them.
        """
        self.switched = switched
        self.written = write_switching_controller(
            switched, name=name, policy_name=policy_name, version=version("glassgait"), real=real
        )

    def check(self, effort: Effort) -> dict[str, pd.DataFrame]:
        with compiled_controller(self.written) as compiled:
            if compiled is None:
                return {}
            say(f"taking {effort.n_steps} steps, in Python and in C")
            switched, recorded, seed = self.switched, effort.n_recorded, effort.seed
            sequences = {
                "recorded": recorded_switching_sequences(switched, recorded, seed),
                "random": random_switching_sequences(
                    switched.robot, switched.switch, effort.n_steps - recorded, seed
                ),
            }
            python = PythonSwitchingController(switched)
            tables = {"agreement": agreement_table(python, compiled, sequences)}
            if effort.n_robots:
                say(f"{effort.n_robots} robots change their gaits, moved by Python and by C")
                tables["closed_loop"] = change_both(
                    switched,
                    compiled,
                    n_robots=effort.n_robots,
                    n_steps=EPISODE_STEPS,
                    seed=effort.seed,
                )
            return tables

    def write(self, folder: Path) -> tuple[Path, ...]:
        source = write_source(self.written, folder)
        return source, source.with_suffix(".h")
