"""Atomic file I/O without pickles: text, YAML, JSON records and arrays."""

import errno
import hashlib
import json
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from safetensors import safe_open
from safetensors.numpy import save

from glassgait.models.errors import InputError, brief

TEXT_BYTES = 1_000_000  # greatest size of a text file that a person writes
YAML_BYTES = 100_000  # greatest size of a YAML file; reading one takes about a second
RECORD_BYTES = 100_000_000  # greatest size of a record that a run writes

_CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x84\x86-\x9f]")

_PATHS = ("gait", "robot", "scenario", "warm_start", "output")
"""Keys of settings that may hold a path instead of a name."""

_SUFFIXES = (".yaml", ".yml", ".formulas", ".safetensors")


def write_atomically(path: Path, data: bytes | str) -> None:
    """Writes a file under a temporary name and renames it, so that no reader sees half of it."""
    temporary = path.parent / f".{path.name}.{os.getpid()}.partial"
    try:
        _refuse_irregular(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with temporary.open("wb") as stream:
                stream.write(data.encode() if isinstance(data, str) else data)
                stream.flush()
                os.fsync(stream.fileno())
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(
            f"{path}: cannot be written ({error.strerror}); choose another place"
        ) from error


def digest(path: Path) -> str:
    """Returns the SHA-256 of a file's bytes, in hexadecimal."""
    return hashlib.sha256(read_bytes(path)).hexdigest()


def read_text(path: Path, limit: int = TEXT_BYTES, encoding: str = "utf-8-sig") -> str:
    """Reads a text file of at most `limit` bytes, and refuses control characters."""
    try:
        text = read_bytes(path, limit).decode(encoding)
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: is not UTF-8 text (byte {error.start}); save it as UTF-8"
        ) from error
    if found := _CONTROL.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise InputError(f"{path}: line {line} holds the control character {found[0]!r}; remove it")
    return text


def resolve_paths(path: Path, values: Any, key: str = "") -> Any:
    """Makes the paths among a file's values absolute; they are relative to its folder."""
    if isinstance(values, dict):
        return {name: resolve_paths(path, value, name) for name, value in values.items()}
    if isinstance(values, list):
        return [resolve_paths(path, value, key) for value in values]
    is_path = isinstance(values, str) and (key == "output" or Path(values).suffix in _SUFFIXES)
    return str((path.parent / values).resolve()) if is_path and key in _PATHS else values


def read_yaml(path: Path) -> Any:
    """Reads plain values from a YAML file; see `parse_yaml`."""
    text = read_text(path, YAML_BYTES)
    try:
        return parse_yaml(text)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def parse_yaml(text: str) -> Any:
    """Reads plain values from YAML text.

    Refuses aliases, which may expand to gigabytes, tags and duplicate keys. Dates stay text.
    """
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"line {mark.line + 1}: " if mark else ""
        problem = where + brief(error.problem or error.context or "")
        raise InputError(f"is not valid YAML ({problem}); correct that line") from error
    except yaml.YAMLError as error:
        raise InputError(f"is not valid YAML ({brief(str(error))}); correct it") from error
    except (ValueError, OverflowError) as error:
        raise InputError(f"holds a number that cannot be read ({brief(str(error))})") from error
    except RecursionError as error:
        raise InputError("is nested too deeply; simplify it") from error


class _Loader(yaml.SafeLoader):
    """Loads safe YAML without aliases, tags, dates or duplicate keys."""

    yaml_implicit_resolvers = {  # noqa: RUF012
        first: [pair for pair in resolvers if not pair[0].endswith((":timestamp", ":merge"))]
        for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }

    def compose_node(self, parent: Any, index: Any) -> Any:
        event = self.peek_event()
        if isinstance(event, yaml.AliasEvent) or event.anchor is not None:
            raise _refusal(event, "anchors and aliases are not allowed")
        if event.tag is not None:
            raise _refusal(event, "tags are not allowed")
        return super().compose_node(parent, index)

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise _refusal(key, "a key is not text")
            if key.value in seen:
                raise _refusal(key, f"key {brief(key.value)!r} is given twice")
            seen.add(key.value)
        return super().construct_mapping(node, deep)


def _refusal(node: Any, problem: str) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=node.start_mark)


def save_arrays(path: Path, arrays: Mapping[str, NDArray[Any]], header: Mapping[str, Any]) -> None:
    """Writes named arrays and a JSON header to one safetensors file, atomically.

    The header's key "sha256" is reserved for a checksum of both.
    """
    little_endian = {
        name: np.ascontiguousarray(value, dtype=value.dtype.newbyteorder("<"))
        for name, value in arrays.items()
    }
    # A single metadata entry: safetensors does not preserve their order, and equal runs must give
    # equal files.
    text = json.dumps({**header, "sha256": _checksum(little_endian, header)})
    write_atomically(path, save(little_endian, metadata={"header": text}))


def load_arrays(path: Path) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Reads the arrays and the header that `save_arrays` wrote; refuses damaged files."""
    try:
        _refuse_irregular(path)
        with safe_open(path, framework="numpy") as file:
            header = json.loads((file.metadata() or {})["header"])
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        # If `ml_dtypes` is installed (ONNX requires it), safetensors also reads other types.
        is_sound = all(array.dtype.isbuiltin == 1 for array in arrays.values())
        checksum = header.pop("sha256", None)
        is_sound = is_sound and checksum in (None, _checksum(arrays, header))
    except OSError as error:
        raise _unreadable(path, error) from error
    except Exception as error:  # its type depends on the damaged byte
        raise InputError(f"{path}: is damaged or was not written by this project") from error
    if not is_sound:
        raise InputError(f"{path}: is damaged, its checksum does not match; make it anew")
    return arrays, header


def write_record(path: Path, values: Any, of: str = "") -> None:
    """Writes the values that a run resumes from, as JSON that keeps every digit and NaN.

    `of` names the run, and the part of it, that the values belong to.
    """
    write_atomically(path, json.dumps({"of": of, "values": values}) + "\n")


def read_record(path: Path, of: str | None = None) -> Any:
    """Reads the values that `write_record` wrote; refuses those of another run or part."""
    data = read_bytes(path, RECORD_BYTES)
    try:
        record = json.loads(data)
        values, written_for = record["values"], record["of"]
    except (ValueError, LookupError, TypeError, RecursionError) as error:
        raise InputError(f"{path}: is damaged; delete it, and --resume makes it anew") from error
    if of is not None and written_for != of:
        raise InputError(
            f"{path}: belongs to another run or part; delete it, and --resume makes it anew"
        )
    return values


def _checksum(arrays: Mapping[str, NDArray[Any]], header: Mapping[str, Any]) -> str:
    names = sorted(arrays)
    kinds = [(name, arrays[name].dtype.str, arrays[name].shape) for name in names]
    hasher = hashlib.sha256(json.dumps([kinds, header]).encode())
    for name in names:
        hasher.update(arrays[name].tobytes())
    return hasher.hexdigest()


def _refuse_irregular(path: Path) -> None:
    """Refuses folders, devices and pipes; opening a pipe would never end."""
    if "\0" in str(path):
        raise OSError(errno.EINVAL, "its name holds a null character")
    if path.exists() and not path.is_file():
        raise IsADirectoryError(errno.EISDIR, "not a regular file")


def read_bytes(path: Path, limit: int | None = None) -> bytes:
    """Reads a file of at most `limit` bytes."""
    try:
        _refuse_irregular(path)
        with path.open("rb") as stream:
            data = stream.read() if limit is None else stream.read(limit + 1)
    except OSError as error:
        raise _unreadable(path, error) from error
    if limit is not None and len(data) > limit:
        raise InputError(f"{path}: is larger than {limit:,} bytes; give another file")
    return data


def _unreadable(path: Path, error: OSError) -> InputError:
    if isinstance(error, FileNotFoundError):
        return InputError(f"{path}: cannot be read, no such file; check the path")
    return InputError(f"{path}: cannot be read ({error.strerror}); check the path")
