"""Records of experts, with their training settings as short recipes."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from glassgait.studies.common.run import to_plain
from glassgait.studies.common.settings_file import read_settings
from glassgait.studies.training.config import TrainingConfig


def recipe(config: TrainingConfig) -> dict[str, Any]:
    """Returns the settings that differ from the defaults, for `read_config`."""
    changed = _differences(to_plain(config), to_plain(TrainingConfig()))
    return {"gait": config.gait, **changed}


def _differences(values: dict[str, Any], defaults: dict[str, Any]) -> dict[str, Any]:
    differences = {}
    for key, value in values.items():
        changed = _differences(value, defaults[key]) if isinstance(value, dict) else value
        if changed not in (defaults[key], {}):
            differences[key] = changed
    return differences


def read_config(path: Path) -> TrainingConfig:
    """Reads an expert's training settings from a record or a settings file."""
    config = read_settings(TrainingConfig(), path)
    start = config.warm_start
    if start is None or Path(start).exists():
        return config
    # A path that does not exist may be relative to the record's folder.
    beside = path.parent / start
    # Ignore the run's result, which may have the same name as the expert of the warm start.
    is_result = beside.with_suffix(path.suffix) == path
    return replace(config, warm_start=str(beside)) if beside.exists() and not is_result else config


def trainings(path: Path) -> list[Path]:
    """Lists the records of an expert's trainings, from the first one to `path`."""
    start = read_config(path).warm_start
    return [*([] if start is None else trainings(Path(start).with_suffix(".yaml"))), path]
