"""Configurations as plain values: written beside every run, and read back."""

from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any

import yaml

from models.errors import InputError


def to_plain(config: Any) -> Any:
    """Turns a configuration into values that YAML and JSON can hold."""
    return _plain(asdict(config) if is_dataclass(config) else config)


def read_yaml(path: Path) -> Any:
    """Reads a YAML file without ever making objects from it.

    Raises:
        InputError: if it cannot be read.
    """
    try:
        return yaml.safe_load(path.read_text())
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the path") from error
    except yaml.YAMLError as error:
        raise InputError(f"{path}: is not valid YAML; mend it") from error


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(entry) for entry in value]
    return str(value) if isinstance(value, Path) else value
