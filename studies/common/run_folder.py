"""One folder, one run: what it is made of, and that nothing else gets mixed into it."""

import hashlib
import json
import platform
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, is_dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import yaml
from filelock import FileLock, Timeout

from glassgait.models.errors import InputError, brief, shown
from glassgait.models.files import digest, read_yaml, write_atomically
from glassgait.models.robots.library import robot_folder
from glassgait.models.robots.robot import DEFAULT_ROBOT

CHECKPOINT_NAME = "checkpoint.safetensors"
CONFIG_NAME = "config.yaml"
LOCK_NAME = ".lock"

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

N_NAMED = 3
"""Differences between a run and its continuation that are named."""

PLACES = ("output", "resume", "sweep", "workers")
"""Settings that say where and how a run is made and kept, not what it is."""


def default_folder(study: str, robot: str = DEFAULT_ROBOT) -> Path:
    """Returns where the runs of a command are kept: in `runs`, by the command's words."""
    return robot_folder(Path("runs", *study.replace("--", "").split()), robot)


@contextmanager
def open_run(
    folder: Path,
    *,
    study: str,
    settings: Any,
    inputs: Mapping[str, str],
    resume: bool,
    free: Collection[str] = (),
) -> Iterator[str]:
    """Claims a folder for a run: a new one, or the very one that it holds.

    What a run is made of stands in its `config.yaml`: its settings, digests of what it reads, and
    the software. A run is continued only where all of them agree, and by one process at a time.

    Args:
        folder: The run's folder.
        study: Name of the command.
        settings: The settings, a dataclass.
        inputs: Digests of all that the run reads, by the name that a sentence calls it; a setting
            of that name, which only says where it was read from, is not compared.
        resume: Whether to continue the run that the folder holds; without one, it is started.
        free: Settings that a continued run may change.

    Yields:
        What identifies the run: its files may be marked as of it.

    Raises:
        InputError: if the folder holds a run and `resume` is not given, the run is of another
            study, settings, inputs or software, the folder holds something else, another process
            is at work in it, or it cannot be written to.
    """
    whole = {
        "study": study,
        "settings": to_plain(settings),
        "inputs": dict(inputs),
        "software": _software(),
    }
    # Refused before anything is written: what does not fit must not leave a trace.
    _check(folder, whole, resume, free)
    absent = [own for own in (folder, *folder.parents) if not own.exists()]
    with _locked(folder):
        # Once more: until the lock was free the folder may have been another's.
        _check(folder, whole, resume, free)
        path = folder / CONFIG_NAME
        before = path.read_text() if path.exists() else None
        write_atomically(path, yaml.safe_dump(whole, sort_keys=False))
        try:
            yield _identity(whole, free)
        except InputError:
            # What was refused before it made anything was no run, nor a part of one.
            if before is not None:
                write_atomically(path, before)
            elif _visible(folder) == [CONFIG_NAME]:
                path.unlink()
                (folder / LOCK_NAME).unlink(missing_ok=True)
                for own in absent or (folder,):
                    with suppress(OSError):
                        # Only an empty folder can be removed: hidden files are a person's own.
                        own.rmdir()
            raise


def refuse_run(folder: Path) -> None:
    """Refuses to write beside the results of a run.

    Raises:
        InputError: if the folder holds a run.
    """
    path = folder / CONFIG_NAME
    found = read_yaml(path) if path.exists() else None
    if isinstance(found, dict) and "study" in found:
        raise InputError(f"{folder}: holds a run; name another folder with --output")


def refuse_to_start(folder: Path, *, study: str, resume: bool) -> None:
    """Refuses a folder where a run would be refused, before others are begun.

    Raises:
        InputError: if the folder holds a run and `resume` is not given, the run is of another
            study, the folder holds something else, or another process is at work in it.
    """
    if (folder / LOCK_NAME).exists():
        with _locked(folder):
            pass
    _check_holds(folder, study, resume)


def read_settings(folder: Path, study: str) -> dict[str, Any]:
    """Reads the settings of the run that a folder holds.

    Raises:
        InputError: if it holds none, or one of another study.
    """
    path = folder / CONFIG_NAME
    return _read(path, study)["settings"]


def read_inputs(folder: Path, study: str) -> dict[str, Any]:
    """Reads the digests of what the run reads that a folder holds.

    Raises:
        InputError: if it holds none, or one of another study.
    """
    return _read(folder / CONFIG_NAME, study)["inputs"]


def digest_of_files(paths: Collection[Path]) -> str:
    """Returns a digest of files' contents and names, not of where they are.

    Raises:
        InputError: if a file cannot be read.
    """
    whole = hashlib.sha256()
    for path in sorted(paths, key=lambda path: path.name):
        whole.update(f"{path.name} {digest(path)}".encode())
    return whole.hexdigest()[:16]


def _software() -> dict[str, str]:
    return {"python": platform.python_version()} | {name: version(name) for name in PACKAGES}


def _check_holds(folder: Path, study: str, resume: bool) -> dict[str, Any] | None:
    """Returns what the run is made of that a folder holds, if it holds one to continue."""
    path = folder / CONFIG_NAME
    if not path.exists():
        if _visible(folder):
            raise InputError(
                f"{folder}: holds files of something else; name a new folder with --output"
            )
        return None
    made_with = _read(path, study)
    if not resume:
        raise InputError(
            f"{folder}: holds a run of '{study}' already; continue it with --resume, or "
            "name another folder with --output"
        )
    return made_with


def _check(folder: Path, whole: dict[str, Any], resume: bool, free: Collection[str]) -> None:
    path = folder / CONFIG_NAME
    made_with = _check_holds(folder, whole["study"], resume)
    if made_with is None:
        return
    differences = _differences(made_with, whole, free)
    if differences:
        named = "; with ".join(brief(difference) for difference in differences[:N_NAMED])
        more = f"; and {len(differences) - N_NAMED} more" if len(differences) > N_NAMED else ""
        raise InputError(
            f"{path}: was made with {named}{more}; continue it with the same, or name another "
            "folder with --output"
        )


def _visible(folder: Path) -> list[str]:
    """Lists what a folder holds besides hidden files."""
    if not folder.is_dir():
        return []
    return [entry.name for entry in folder.iterdir() if not entry.name.startswith(".")]


def _read(path: Path, study: str) -> dict[str, Any]:
    found = read_yaml(path)
    parts = ("settings", "inputs", "software")
    if not isinstance(found, dict) or any(not isinstance(found.get(key), dict) for key in parts):
        raise InputError(f"{path}: is damaged, or not of this version; name another folder")
    if found.get("study") != study:
        raise InputError(
            f"{path.parent}: holds a run of '{shown(found.get('study'))[1:-1]}', not of "
            f"'glassgait {study}'; name another folder"
        )
    return found


def _identity(whole: dict[str, Any], free: Collection[str]) -> str:
    parts = [
        _flat(whole[part], (*free, *PLACES), whole["inputs"]) for part in ("settings", "software")
    ]
    made_of = json.dumps([whole["study"], whole["inputs"], *parts], sort_keys=True)
    return hashlib.sha256(made_of.encode()).hexdigest()[:16]


def _differences(then: dict[str, Any], now: dict[str, Any], free: Collection[str]) -> list[str]:
    left_out = (*free, *PLACES)
    found = []
    for part in ("settings", "software"):
        before, after = (_flat(whole[part], left_out, now["inputs"]) for whole in (then, now))
        found += [
            f"{key} = {shown(before.get(key))}, not {shown(after.get(key))}"
            for key in sorted({*before, *after})
            if before.get(key) != after.get(key)
        ]
    found += [
        f"another {name.removesuffix('s')}"
        for name, digest in now["inputs"].items()
        if then["inputs"].get(name, digest) != digest
    ]
    return found


def _flat(
    values: dict[str, Any], left_out: Collection[str], inputs: Collection[str], prefix: str = ""
) -> dict[str, Any]:
    """Names nested settings by their path, such as `station.friction`, but for what is left out."""
    flat: dict[str, Any] = {}
    for key, value in values.items():
        name = f"{prefix}{key}"
        if name in left_out or key in inputs:
            continue
        if isinstance(value, dict):
            flat |= _flat(value, left_out, inputs, f"{name}.")
        else:
            flat[name] = value
    return flat


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = FileLock(folder / LOCK_NAME, timeout=0)
        lock.acquire()
    except Timeout as error:
        raise InputError(
            f"{folder}: another run is at work here; wait for it, or name another folder with "
            "--output"
        ) from error
    except OSError as error:
        raise InputError(
            f"{folder}: cannot be written to ({error.strerror}); name another folder with --output"
        ) from error
    try:
        yield
    finally:
        lock.release()


def to_plain(config: Any) -> Any:
    """Turns a configuration into values that YAML and JSON can hold."""
    return _plain(
        asdict(config) if is_dataclass(config) and not isinstance(config, type) else config
    )


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(entry) for entry in value]
    return str(value) if isinstance(value, Path) else value
