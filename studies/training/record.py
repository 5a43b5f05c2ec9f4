"""Records of experts: how they were trained, as recipes of a few lines."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from glassgait.studies.common.run import to_plain
from glassgait.studies.common.settings_file import read_settings
from glassgait.studies.training.config import TrainingConfig


def recipe(config: TrainingConfig) -> dict[str, Any]:
    """Returns the settings that differ from the defaults, as `read_config` reads them."""
    changed = _differences(to_plain(config), to_plain(TrainingConfig()))
    return {"gait": config.gait, **changed}


def _differences(values: dict[str, Any], defaults: dict[str, Any]) -> dict[str, Any]:
    found = {}
    for key, value in values.items():
        changed = _differences(value, defaults[key]) if isinstance(value, dict) else value
        if changed not in (defaults[key], {}):
            found[key] = changed
    return found


def read_config(path: Path) -> TrainingConfig:
    """Reads from a record or a settings file how an expert is trained."""
    config = read_settings(TrainingConfig(), path)
    start = config.warm_start
    if start is None or Path(start).exists():
        return config
    # Shipped records can be followed from anywhere: paths are looked for from their folder, too.
    beside = path.parent / start
    # The run's result may have the name of the expert that it began as.
    is_result = beside.with_suffix(path.suffix) == path
    return replace(config, warm_start=str(beside)) if beside.exists() and not is_result else config


def trainings(path: Path) -> list[Path]:
    """Lists the records of an expert's trainings from the first one to its record, the last."""
    start = read_config(path).warm_start
    return [*([] if start is None else trainings(Path(start).with_suffix(".yaml"))), path]
