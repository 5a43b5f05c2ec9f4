"""Files that are either whole or not there, and read back without running anything in them."""

import errno
import hashlib
import json
import os
import re
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from glob import escape
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from glassgait.models.errors import InputError
from glassgait.models.plain_yaml import parse_yaml

TEXT_BYTES = 1_000_000
"""Greatest size of a text file that a person writes."""

YAML_BYTES = 100_000
"""Greatest size of a YAML file, which takes about a second to read."""

RECORD_BYTES = 100_000_000
"""Greatest size of a record that a run writes."""

_CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x84\x86-\x9f]")

_PARTIAL = re.compile(r"\..+\.(\d+)\.partial")

_REMEDIES = {
    errno.ENOSPC: "free some space",
    errno.EDQUOT: "free some space",
    errno.EISDIR: "give the path of a file, not of a folder",
    errno.ENOTDIR: "a part of the path is a file; choose another folder",
    errno.EEXIST: "a part of the path is a file; choose another folder",
    errno.ENAMETOOLONG: "choose a shorter name",
}

# What safetensors raises on damage, besides its own error, depends on which byte is hurt.
_DAMAGE = (
    SafetensorError,
    ValueError,
    KeyError,
    TypeError,
    AttributeError,
    OverflowError,
    RecursionError,
    MemoryError,
)


def write_atomically(path: Path, data: bytes | str) -> None:
    """Writes a file under a temporary name and renames it, so that no reader sees half of it.

    Raises:
        InputError: if it cannot be written there; what was there before is kept.
    """
    temporary = path.parent / f".{path.name}.{os.getpid()}.partial"
    try:
        if path.exists() and not path.is_file():
            # A device or a pipe would be replaced by a file.
            raise IsADirectoryError(errno.EISDIR, "it is no regular file")
        path.parent.mkdir(parents=True, exist_ok=True)
        _remove_dead(path.parent.glob(f".{escape(path.name)}.*.partial"))
        try:
            with temporary.open("wb") as stream:
                stream.write(data.encode() if isinstance(data, str) else data)
                stream.flush()
                os.fsync(stream.fileno())
            temporary.replace(path)
        except BaseException:
            with suppress(OSError):
                temporary.unlink()
            raise
    except OSError as error:
        remedy = _REMEDIES.get(error.errno or 0, "choose another place")
        raise InputError(f"{path}: cannot be written ({error.strerror}); {remedy}") from error


def remove_litter(folder: Path) -> None:
    """Removes what processes that were killed while they wrote have left under a folder."""
    _remove_dead(folder.rglob(".*.partial"))


def digest(path: Path) -> str:
    """Returns the SHA-256 of a file's bytes, in hexadecimal.

    Raises:
        InputError: if it cannot be read.
    """
    try:
        with _regular(path).open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise _unreadable(path, error) from error


def read_text(path: Path, limit: int = TEXT_BYTES, encoding: str = "utf-8-sig") -> str:
    """Reads a text file that a person wrote.

    Args:
        path: The file.
        limit: Greatest size (bytes).
        encoding: "utf-8" where a byte order mark counts as a character, too.

    Raises:
        InputError: if it cannot be read, is larger, is not UTF-8 or holds control characters.
    """
    try:
        text = _read_bytes(path, limit).decode(encoding)
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: is not UTF-8 text (byte {error.start}); save it as UTF-8"
        ) from error
    if found := _CONTROL.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise InputError(f"{path}: line {line} holds the control character {found[0]!r}; remove it")
    return text


def read_yaml(path: Path) -> Any:
    """Reads plain values from a YAML file.

    Raises:
        InputError: if it cannot be read, is not valid, or holds more than plain values.
    """
    text = read_text(path, YAML_BYTES)
    try:
        return parse_yaml(text)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def save_arrays(path: Path, arrays: Mapping[str, NDArray[Any]], header: Mapping[str, Any]) -> None:
    """Writes named arrays, a JSON header and their checksum to one safetensors file, atomically.

    The header's own key "sha256" is kept for the checksum.
    """
    whole = {
        name: np.ascontiguousarray(value, dtype=value.dtype.newbyteorder("<"))
        for name, value in arrays.items()
    }
    # In the header and not beside it: safetensors does not keep the order of its metadata, and
    # equal runs give equal files.
    text = json.dumps({**header, "sha256": _checksum(whole, header)})
    write_atomically(path, save(whole, metadata={"header": text}))


def load_arrays(path: Path) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Reads back the arrays and the header that `save_arrays` wrote.

    Raises:
        InputError: if the file is missing, cut short or not one of ours, or its checksum, where it
            has one, is of other contents.
    """
    try:
        with safe_open(_regular(path), framework="numpy") as file:
            metadata = file.metadata() or {}
            header = json.loads(metadata["header"])
            arrays = {name: _native(file.get_tensor(name)) for name in file.keys()}  # noqa: SIM118
        checksum = header.pop("sha256", None)
        whole = checksum is None or checksum == _checksum(arrays, header)
    except OSError as error:
        raise _unreadable(path, error) from error
    except _DAMAGE as error:
        raise InputError(f"{path}: is damaged or was not written by this project") from error
    if not whole:
        raise InputError(f"{path}: is damaged, its checksum is of other contents; make it anew")
    return arrays, header


def _native(array: NDArray[Any]) -> NDArray[Any]:
    # With `ml_dtypes` installed, which ONNX brings, arrays of its own types would be read too.
    if array.dtype.isbuiltin != 1:
        raise ValueError(f"arrays of {array.dtype} are not ours")
    return array


def write_record(path: Path, values: Any, of: str = "") -> None:
    """Writes what a run needs in order to resume, as JSON with a checksum, atomically.

    Floats keep every digit, and NaN stays NaN.

    Args:
        path: The file.
        values: What JSON can hold.
        of: What they are of: the run and the part of it.
    """
    text = json.dumps({"of": of, "values": values})
    write_atomically(path, f'{{"sha256": "{_hash(text)}", "record": {text}}}\n')


def read_record(path: Path, of: str | None = None) -> Any:
    """Reads back the values that `write_record` wrote.

    Args:
        path: The file.
        of: What they must be of; anything by default.

    Raises:
        InputError: if the file is missing, damaged, or of something else.
    """
    data = _read_bytes(path, RECORD_BYTES)
    try:
        whole = json.loads(data)
        record = whole["record"]
        sound = whole["sha256"] == _hash(json.dumps(record))
        values, theirs = record["values"], record["of"]
    except (ValueError, KeyError, TypeError, RecursionError):
        sound = False
    if not sound:
        raise InputError(f"{path}: is damaged; delete it, and --resume makes it anew")
    refuse_another(path, theirs, of)
    return values


def record_or_made(path: Path, make: Callable[[], Any], *, of: str) -> Any:
    """Returns what a run kept before, or makes it and keeps it.

    Args:
        path: The file.
        make: Returns what JSON can hold, and may take long.
        of: What it is of: the run and the part of it.

    Raises:
        InputError: if the file is damaged, or of something else.
    """
    if not path.exists():
        write_record(path, make(), of=of)
    return read_record(path, of=of)


def refuse_another(path: Path, theirs: Any, of: str | None) -> None:
    """Refuses a file that is sound but of something else, such as another run.

    Args:
        path: The file.
        theirs: What it says that it is of.
        of: What it must be of; anything if None.

    Raises:
        InputError: if the two differ.
    """
    if of is not None and theirs != of:
        raise InputError(
            f"{path}: is of another run, or of another part of this one; delete it, and --resume "
            "makes it anew"
        )


def _checksum(arrays: Mapping[str, NDArray[Any]], header: Mapping[str, Any]) -> str:
    names = sorted(arrays)
    kinds = [(name, arrays[name].dtype.str, arrays[name].shape) for name in names]
    hasher = hashlib.sha256(json.dumps([kinds, header]).encode())
    for name in names:
        hasher.update(arrays[name].tobytes() if arrays[name].size == 0 else arrays[name].data)
    return hasher.hexdigest()


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _regular(path: Path) -> Path:
    """Refuses what is there but no file: opening a pipe, for one, would never end."""
    if path.exists() and not path.is_file():
        raise IsADirectoryError(errno.EISDIR, "it is no regular file")
    return path


def _read_bytes(path: Path, limit: int) -> bytes:
    try:
        with _regular(path).open("rb") as stream:
            data = stream.read(limit + 1)
    except OSError as error:
        raise _unreadable(path, error) from error
    if len(data) > limit:
        raise InputError(f"{path}: is larger than {limit:,} bytes; give another file")
    return data


def _unreadable(path: Path, error: OSError) -> InputError:
    if isinstance(error, FileNotFoundError):
        return InputError(f"{path}: cannot be read, no such file; check the path")
    return InputError(f"{path}: cannot be read ({error.strerror}); check the path")


def _remove_dead(partials: Iterable[Path]) -> None:
    """Removes partial files whose writer lives no more; its process id stands in their names."""
    for partial in list(partials):
        found = _PARTIAL.fullmatch(partial.name)
        if found and not psutil.pid_exists(int(found[1])):
            with suppress(OSError):
                partial.unlink()
