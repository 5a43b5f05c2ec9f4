"""Settings files: what a study is by its published settings, which the command line changes."""

from pathlib import Path
from typing import Any, TypeVar

import pandas as pd

from glassgait.models.errors import InputError, shown
from glassgait.models.files import read_yaml
from glassgait.models.settings import Settings
from glassgait.studies.common.run import default_folder, to_plain

SETTINGS_FOLDER = Path(__file__).parent

STUDY = "study"
"""Key of a settings file that names the study."""

QUICK = "quick"
"""Key of a settings file that holds what a quick run does less of."""

BESIDE = ("output", "resume", "sweep", "workers", "quick", "engine", "policy", "robot")
"""Settings that are no difference from what was published, or show in another one."""

S = TypeVar("S", bound=Settings)


def settings_file(name: str) -> Path:
    """Returns the file of settings that ship, by their name, or of one's own, by its path."""
    return Path(name) if Path(name).suffix == ".yaml" else SETTINGS_FOLDER / f"{name}.yaml"


def study_of(path: Path) -> str:
    """Returns the name of the study that a settings file is for.

    Raises:
        InputError: if the file cannot be read, or names none.
    """
    study = _mapping(path).get(STUDY)
    known = sorted({str(_mapping(own).get(STUDY)) for own in SETTINGS_FOLDER.glob("*.yaml")})
    if study not in known:
        raise InputError(
            f"{path}: key {STUDY!r} is {shown(study)}; it must be one of {', '.join(known)}"
        )
    return study


def load_settings(kind: type[S], path: Path, *, quick: bool = False) -> S:
    """Reads a settings file.

    Args:
        kind: The study's class.
        path: The file.
        quick: Whether to do less: what stands under the file's key `quick` replaces the rest.

    Raises:
        InputError: if the file cannot be read or breaks a rule; the message names file and key.
    """
    values = _mapping(path)
    less = values.pop(QUICK, None)
    values.pop(STUDY, None)
    if path.parent != SETTINGS_FOLDER:
        folder = default_folder(f"reproduce {path.stem}{'_quick' * quick}")
        values = {"output": str(folder)} | values
    if quick and not isinstance(less, dict):
        raise InputError(
            f"{path}: has no settings under the key {QUICK!r}; add them, or leave --quick out"
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


def _mapping(path: Path) -> dict[str, Any]:
    values = read_yaml(path)
    if not isinstance(values, dict):
        raise InputError(f"{path}: is not a mapping of settings; start from that of 'paper'")
    return values


def _merged(values: Any, changes: Any) -> Any:
    """Replaces values by those of the same key, inside of mappings too."""
    if not isinstance(values, dict) or not isinstance(changes, dict):
        return changes
    merged = {key: _merged(values.get(key), change) for key, change in changes.items()}
    return {**values, **merged}
