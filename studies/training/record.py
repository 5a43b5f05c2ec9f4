"""Records of experts, with their training settings as short recipes."""

from pathlib import Path
from typing import Any

from glassgait.studies.common.run import to_plain, to_record
from glassgait.studies.common.settings_file import read_settings
from glassgait.studies.training.config import TrainingConfig


def recipe(config: TrainingConfig) -> dict[str, Any]:
    """Returns the settings that differ from the defaults, for `read_settings`."""
    values = to_record(config)
    return {"gait": values["gait"], **_differences(values, to_plain(TrainingConfig()))}


def _differences(values: dict[str, Any], defaults: dict[str, Any]) -> dict[str, Any]:
    differences = {}
    for key, value in values.items():
        changed = _differences(value, defaults[key]) if isinstance(value, dict) else value
        if changed not in (defaults[key], {}):
            differences[key] = changed
    return differences


def trainings(path: Path) -> list[Path]:
    """Lists the records of an expert's trainings, from the first one to `path`."""
    start = read_settings(TrainingConfig(), path).warm_start
    return [*([] if start is None else trainings(Path(start).with_suffix(".yaml"))), path]
