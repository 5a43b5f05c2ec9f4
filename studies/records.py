"""Configurations as plain values: written beside every run, and read back into dataclasses."""

from dataclasses import asdict, fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

from models.errors import InputError, shown
from models.files import read_yaml

__all__ = ["from_plain", "read_yaml", "to_plain"]

T = TypeVar("T")


def to_plain(config: Any) -> Any:
    """Turns a configuration into values that YAML and JSON can hold."""
    return _plain(asdict(config) if is_dataclass(config) else config)


def from_plain(kind: type[T], values: Any, where: str) -> T:
    """Builds a configuration from plain values.

    Args:
        kind: The dataclass.
        values: Its fields by name; those left out keep their defaults.
        where: What an error calls the source.

    Raises:
        InputError: if a key is unknown or a value does not fit its field.
    """
    if not isinstance(values, dict):
        raise InputError(f"{where}: is not a mapping of settings; mend it")
    hints = get_type_hints(kind)
    known = {field.name for field in fields(kind)}  # type: ignore[arg-type]
    arguments = {}
    for key, value in values.items():
        if key not in known:
            raise InputError(
                f"{where}: unknown key {shown(key)}; the keys are {', '.join(sorted(known))}"
            )
        arguments[key] = _fitted(hints[key], value, f"{where}: key {shown(key)}")
    try:
        return kind(**arguments)
    except (InputError, TypeError, ValueError) as error:
        raise InputError(f"{where}: {error}") from error


def _fitted(hint: Any, value: Any, where: str) -> Any:
    if is_dataclass(hint):
        return from_plain(hint, value, where)  # type: ignore[arg-type]
    if isinstance(value, list):
        return tuple(value)
    if hint in (int, float, str, bool):
        number = hint is float and type(value) is int
        if type(value) is not hint and not number:
            raise InputError(f"{where}: must be {hint.__name__}, not {shown(value)}")
        return hint(value)
    return value


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(entry) for entry in value]
    return str(value) if isinstance(value, Path) else value
