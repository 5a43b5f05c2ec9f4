"""Run folders: one run each, with a record of what it was made of."""

import platform
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, is_dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import yaml

from glassgait.models.errors import InputError, brief, shown
from glassgait.models.files import read_yaml, write_atomically
from glassgait.models.robots.library import robot_folder
from glassgait.models.robots.robot import DEFAULT_ROBOT

CHECKPOINT_NAME = "checkpoint.safetensors"
CONFIG_NAME = "config.yaml"

PACKAGES = (
    "glassgait",
    "drake",
    "interpret-core",
    "numpy",
    "pyoperon",
    "rsl-rl-lib",
    "scikit-learn",
    "scipy",
    "torch",
)
"""The software that results depend on."""

PLACES = ("output", "resume", "workers")
"""Settings that change where and how a run is made, but not its results."""


def default_folder(study: str, robot: str = DEFAULT_ROBOT) -> Path:
    """Returns the folder below `runs` in which the runs of a command are kept."""
    return robot_folder(Path("runs", *study.split()), robot)


@contextmanager
def open_run(
    folder: Path,
    *,
    study: str,
    settings: Any,
    inputs: Mapping[str, str],
    resume: bool = False,
    free: Collection[str] = (),
) -> Iterator[None]:
    """Claims a folder for a run, and writes settings, inputs and software to its `config.yaml`.

    The folder must be empty, unless the run that it holds is resumed; else an InputError says so.
    `inputs` are digests of what the run reads; a setting of the same name, which says where it was
    read from, is not compared. A continued run may change the `free` settings.
    """
    software = {"python": platform.python_version()} | {name: version(name) for name in PACKAGES}
    record = {"study": study, "settings": to_plain(settings), "inputs": dict(inputs)}
    record["software"] = software
    path = folder / CONFIG_NAME

    # Check before writing anything: a refused command must not leave a trace.
    begun = path.exists()
    if begun and not resume:
        refuse_run(folder, "continue it with --resume, or ")
    elif begun:
        _refuse_another(path, record, {*free, *PLACES, *inputs})
    elif _visible(folder):
        raise InputError(f"{folder}: holds other files; name a new folder with --output")

    # Write the record, and let the caller work.
    write_atomically(path, yaml.safe_dump(record, sort_keys=False))
    try:
        yield
    except InputError:
        # A run that was refused before it wrote anything leaves no folder behind.
        if not begun and _visible(folder) == [CONFIG_NAME]:
            path.unlink()
            with suppress(OSError):
                folder.rmdir()
        raise


def read_run(folder: Path, study: str) -> dict[str, Any]:
    """Reads the record of a folder's run, and refuses one of another study."""
    path = folder / CONFIG_NAME
    found = read_yaml(path)
    parts = ("settings", "inputs", "software")
    if not isinstance(found, dict) or any(not isinstance(found.get(key), dict) for key in parts):
        raise InputError(f"{path}: is damaged, or not of this version; name another folder")
    if found.get("study") != study:
        theirs = shown(found.get("study"))[1:-1]
        raise InputError(
            f"{folder}: holds a run of '{theirs}', not of 'glassgait {study}'; name another folder"
        )
    return found


def refuse_run(folder: Path, remedy: str = "") -> None:
    """Raises an InputError if a folder holds a run, beside whose results nothing is written."""
    if (folder / CONFIG_NAME).exists():
        raise InputError(f"{folder}: holds a run; {remedy}name another folder with --output")


def to_plain(config: Any) -> Any:
    """Turns a configuration into values that YAML and JSON can hold."""
    if is_dataclass(config) and not isinstance(config, type):
        config = asdict(config)
    if isinstance(config, dict):
        return {key: to_plain(entry) for key, entry in config.items()}
    if isinstance(config, list | tuple):
        return [to_plain(entry) for entry in config]
    return str(config) if isinstance(config, Path) else config


def _refuse_another(path: Path, record: dict[str, Any], free: Collection[str]) -> None:
    """Refuses to continue a run with other settings, inputs or software than its record has."""
    before, now = (
        _flat({key: value for key, value in own["settings"].items() if key not in free})
        | _flat({"inputs": own["inputs"], "software": own["software"]})
        for own in (read_run(path.parent, record["study"]), record)
    )
    differences = [
        brief(f"{key} = {shown(before.get(key))}, not {shown(now.get(key))}")
        for key in sorted({*before, *now})
        if before.get(key) != now.get(key)
    ]
    if differences:
        # Three are enough to see what was changed.
        raise InputError(
            f"{path}: was made with {'; with '.join(differences[:3])}; continue it with the same, "
            "or name another folder with --output"
        )


def _flat(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Returns nested settings by paths such as `station.friction`."""
    flat: dict[str, Any] = {}
    for key, value in values.items():
        nested = isinstance(value, dict)
        flat |= _flat(value, f"{prefix}{key}.") if nested else {f"{prefix}{key}": value}
    return flat


def _visible(folder: Path) -> list[str]:
    """Lists what a folder holds besides hidden files."""
    if not folder.is_dir():
        return []
    return [entry.name for entry in folder.iterdir() if not entry.name.startswith(".")]
