"""The settings of a reproduction: read from a file that a person can lay beside the paper."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import pandas as pd
from annotated_types import MinLen

from glassgait.models.errors import InputError, shown
from glassgait.models.files import read_yaml
from glassgait.models.settings import DISTINCT, FEW
from glassgait.studies.common.serialization import to_plain
from glassgait.studies.distillation.students.symbolic import SYMBOLIC
from glassgait.studies.distillation.students.symbolic_regression import Engine, SymbolicSettings
from glassgait.studies.reproduction.report.config import PAPER_GAITS, ReportConfig
from glassgait.studies.training.config import TrainingConfig

SETTINGS_FOLDER = Path(__file__).parent

QUICK = "quick"
"""Key of a settings file that holds what a quick run does less of."""


@dataclass(frozen=True)
class ReproduceConfig(ReportConfig):
    """All that is done again: experts, students, rollouts and importances.

    Attributes:
        gaits: Names of the gaits.
        training: How experts learn; the gait is set for each.
        distillation: How they are distilled; the gait is set for each.
        periods: Control steps from one action of the expert to the next, at each of which students
            are rolled out; 0 is never.
        rollouts: How robots are rolled out.
        n_samples: Held-out samples that importances are measured on.
        repeats: Shuffles of each observation.
    """

    title: ClassVar[str] = "reproduce"

    gaits: Annotated[tuple[str, ...], MinLen(1), FEW, DISTINCT] = PAPER_GAITS
    training: TrainingConfig = field(default_factory=TrainingConfig)

    @property
    def engine(self) -> Engine | None:
        """What searches the formulas; None where there are none."""
        settings = self.distillation.settings.of(SYMBOLIC.name)
        assert isinstance(settings, SymbolicSettings)
        return settings.engine if SYMBOLIC.name in self.distillation.students else None

    def with_engine(self, engine: Engine) -> "ReproduceConfig":
        """Returns the settings with another engine for the formulas."""
        settings = self.distillation.settings
        symbolic = replace(settings.of(SYMBOLIC.name), engine=engine)
        students = replace(settings, **{SYMBOLIC.name: symbolic})
        return replace(self, distillation=replace(self.distillation, settings=students))


def settings_file(name: str) -> Path:
    """Returns the file of settings that ship, by their name, or of one's own, by its path.

    Raises:
        InputError: if there are no such settings.
    """
    shipped = sorted(path.stem for path in SETTINGS_FOLDER.glob("*.yaml"))
    if name in shipped:
        return SETTINGS_FOLDER / f"{name}.yaml"
    if Path(name).suffix != ".yaml":
        raise InputError(
            f"unknown settings {shown(name)}; name {' or '.join(shipped)}, or the path of a file "
            "that ends in .yaml"
        )
    return Path(name)


def load_settings(path: Path, *, quick: bool = False) -> ReproduceConfig:
    """Reads a settings file.

    Args:
        path: The file.
        quick: Whether to do less: what stands under the file's key `quick` replaces the rest.

    Raises:
        InputError: if the file cannot be read or breaks a rule; the message names file and key.
    """
    values = read_yaml(path)
    if not isinstance(values, dict):
        raise InputError(f"{path}: is not a mapping of settings; start from that of 'paper'")
    less = values.pop(QUICK, None)
    if not quick:
        return ReproduceConfig.from_plain(values, str(path))
    if not isinstance(less, dict):
        raise InputError(
            f"{path}: has no settings under the key {QUICK!r}; add them, or leave --quick out"
        )
    return ReproduceConfig.from_plain(_merged(values, less), str(path))


def differences(full: ReproduceConfig, here: ReproduceConfig) -> pd.DataFrame:
    """Lists the settings that differ: a row each, with its key and both values."""
    before, after = (pd.json_normalize(to_plain(config)).iloc[0] for config in (full, here))
    rows = [
        {"setting": key, "in full": str(before[key]), "here": str(after[key])}
        for key in before.index
        if before[key] != after[key]
    ]
    return pd.DataFrame(rows, columns=pd.Index(["setting", "in full", "here"]))


def _merged(values: Any, changes: Any) -> Any:
    """Replaces values by those of the same key, inside of mappings too."""
    if not isinstance(values, dict) or not isinstance(changes, dict):
        return changes
    merged = {key: _merged(values.get(key), change) for key, change in changes.items()}
    return {**values, **merged}
