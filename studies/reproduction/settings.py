"""Settings files of `glassgait reproduce`."""

from pathlib import Path
from typing import TypeVar

from glassgait.models.errors import InputError
from glassgait.models.files import read_yaml, resolve_paths
from glassgait.models.settings import Settings
from glassgait.studies.common.run import default_folder
from glassgait.studies.common.settings_file import merged

SETTINGS_FOLDER = Path(__file__).parent

S = TypeVar("S", bound=Settings)


def settings_file(name: str) -> Path:
    """Returns the path of a settings file, given as a path or as the name of one that ships."""
    return Path(name) if Path(name).suffix == ".yaml" else SETTINGS_FOLDER / f"{name}.yaml"


def load_settings(kind: type[S], path: Path, *, quick: bool = False) -> S:
    """Reads a settings file; in a quick run, values under its key `quick` replace the others."""
    values = read_yaml(path)
    if not isinstance(values, dict):
        raise InputError(f"{path}: is not a mapping of settings; start from a copy of paper.yaml")
    values = resolve_paths(path, values)
    quick_values = values.pop("quick", None)
    # A file that does not ship has a separate folder of results.
    if path.parent != SETTINGS_FOLDER:
        folder = default_folder(f"reproduce {path.stem}{'_quick' * quick}")
        values = {"output": str(folder)} | values
    if quick and not isinstance(quick_values, dict):
        raise InputError(
            f"{path}: has no settings under the key 'quick'; add them, or leave --quick out"
        )
    return kind.from_plain(merged(values, quick_values) if quick else values, str(path))
