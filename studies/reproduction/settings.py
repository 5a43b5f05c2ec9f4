"""Settings files, which the command line changes."""

from pathlib import Path
from typing import Any, TypeVar

import pandas as pd

from glassgait.models.errors import InputError
from glassgait.models.files import read_yaml, resolve_paths
from glassgait.models.settings import Settings
from glassgait.studies.common.run import default_folder, to_plain

SETTINGS_FOLDER = Path(__file__).parent

BESIDE = ("output", "resume", "workers", "quick", "engine", "robot")
"""Settings that do not count as a difference, or show in another setting."""

S = TypeVar("S", bound=Settings)


def settings_file(name: str) -> Path:
    """Returns a file of settings by its path, or one that ships by its name."""
    return Path(name) if Path(name).suffix == ".yaml" else SETTINGS_FOLDER / f"{name}.yaml"


def load_settings(kind: type[S], path: Path, *, quick: bool = False) -> S:
    """Reads a settings file; of a quick run the values under its key `quick` replace others."""
    values = read_yaml(path)
    if not isinstance(values, dict):
        raise InputError(f"{path}: is not a mapping of settings; start from that of 'paper'")
    values = resolve_paths(path, values)
    less = values.pop("quick", None)
    # Results of a person's file stay apart from those of the files that ship.
    if path.parent != SETTINGS_FOLDER:
        folder = default_folder(f"reproduce {path.stem}{'_quick' * quick}")
        values = {"output": str(folder)} | values
    if quick and not isinstance(less, dict):
        raise InputError(
            f"{path}: has no settings under the key 'quick'; add them, or leave --quick out"
        )
    return kind.from_plain(_merged(values, less) if quick else values, str(path))


def differences(full: Settings, here: Settings) -> pd.DataFrame:
    """Lists the settings that differ: a row each, with its key and both values."""
    before, after = (pd.json_normalize(to_plain(own)).iloc[0] for own in (full, here))
    rows = [
        {"setting": key, "in full": str(before[key]), "here": str(after.get(key))}
        for key in before.index
        if key.split(".")[0] not in BESIDE and before[key] != after.get(key)
    ]
    return pd.DataFrame(rows, columns=pd.Index(["setting", "in full", "here"]))


def _merged(values: Any, changes: Any) -> Any:
    """Replaces values by those of the same key, inside of mappings too."""
    if not isinstance(values, dict) or not isinstance(changes, dict):
        return changes
    merged = {key: _merged(values.get(key), change) for key, change in changes.items()}
    return {**values, **merged}
