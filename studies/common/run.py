"""Run folders: each contains one run, with a record of its settings, inputs and software."""

import platform
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, is_dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import yaml

from glassgait.models.errors import InputError, brief, shown
from glassgait.models.files import read_yaml, resolve_paths, write_atomically
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

PLACES = ("output", "resume", "workers")  # settings that do not affect a run's results


def default_folder(study: str, robot: str = DEFAULT_ROBOT) -> Path:
    """Returns the folder below `runs` for the runs of a command."""
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

    Raises an InputError if the folder is not empty, or contains another run than the resumed one:
    settings (except `free` ones), inputs and software must be equal. `inputs` are digests of what
    the run reads; settings of the same name only locate it and are not compared.
    """
    software = {"python": platform.python_version()} | {name: version(name) for name in PACKAGES}
    record = {"study": study, "settings": to_record(settings), "inputs": dict(inputs)}
    record["software"] = software
    path = folder / CONFIG_NAME

    # Check before writing, so that bad input leaves no files.
    begun = path.exists()
    if begun and not resume:
        refuse_run(folder, "continue it with --resume, or ")
    elif begun:
        _check_same_run(path, record, {*free, *PLACES, *inputs})
    elif _visible(folder):
        raise InputError(f"{folder}: holds other files; give a new folder with --output")

    # Write the record, and let the caller work.
    write_atomically(path, yaml.safe_dump(record, sort_keys=False))
    try:
        yield
    except InputError:
        # Remove the folder of a new run that wrote nothing else.
        if not begun and _visible(folder) == [CONFIG_NAME]:
            path.unlink()
            with suppress(OSError):
                folder.rmdir()
        raise


def read_run(folder: Path, study: str) -> dict[str, Any]:
    """Reads the record of a run; raises an InputError if it is of another study."""
    path = folder / CONFIG_NAME
    record = read_yaml(path)
    keys = ("settings", "inputs", "software")
    if not isinstance(record, dict) or any(not isinstance(record.get(key), dict) for key in keys):
        raise InputError(f"{path}: is damaged, or not of this version; give another folder")
    if record.get("study") != study:
        other = shown(record.get("study"))[1:-1]
        raise InputError(
            f"{folder}: holds a run of '{other}', not of 'glassgait {study}'; give another folder"
        )
    return record


def refuse_run(folder: Path, remedy: str = "") -> None:
    """Raises an InputError if a folder contains a run, to protect its results."""
    if (folder / CONFIG_NAME).exists():
        raise InputError(f"{folder}: holds a run; {remedy}give another folder with --output")


def to_plain(config: Any) -> Any:
    """Converts a configuration to plain values for YAML and JSON."""
    if is_dataclass(config) and not isinstance(config, type):
        config = asdict(config)
    if isinstance(config, dict):
        return {key: to_plain(entry) for key, entry in config.items()}
    if isinstance(config, list | tuple):
        return [to_plain(entry) for entry in config]
    return str(config) if isinstance(config, Path) else config


def to_record(config: Any) -> Any:
    """Turns a configuration into plain values for a file, in which paths are absolute."""
    return resolve_paths(Path.cwd() / CONFIG_NAME, to_plain(config))


def _check_same_run(path: Path, record: dict[str, Any], free: Collection[str]) -> None:
    """Raises an InputError if settings, inputs or software differ from the run's record."""
    before, now = (
        _flat({key: value for key, value in values["settings"].items() if key not in free})
        | _flat({"inputs": values["inputs"], "software": values["software"]})
        for values in (read_run(path.parent, record["study"]), record)
    )
    differences = [
        brief(f"{key} = {shown(before.get(key))}, not {shown(now.get(key))}")
        for key in sorted({*before, *now})
        if before.get(key) != now.get(key)
    ]
    if differences:
        # Show at most three differences.
        raise InputError(
            f"{path}: was made with {'; with '.join(differences[:3])}; resume it without changes, "
            "or give another folder with --output"
        )


def _flat(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Flattens nested settings to keys such as `station.friction`."""
    flat: dict[str, Any] = {}
    for key, value in values.items():
        nested = isinstance(value, dict)
        flat |= _flat(value, f"{prefix}{key}.") if nested else {f"{prefix}{key}": value}
    return flat


def _visible(folder: Path) -> list[str]:
    """Lists the entries of a folder that are not hidden."""
    if not folder.is_dir():
        return []
    return [entry.name for entry in folder.iterdir() if not entry.name.startswith(".")]
