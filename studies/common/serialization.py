"""Configurations as plain values: written beside every run, and read back."""

from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any


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
