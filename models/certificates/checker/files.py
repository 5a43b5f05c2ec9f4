"""Reads the files that are checked: regular ones up to a size, in which each key is given once."""

import json
import math
import stat
from pathlib import Path
from typing import Any

import yaml

MOST_BYTES = 100_000_000
"""Greatest size of a certificate or a policy. A YAML file may have a thousandth of it."""


class RefusedError(Exception):
    """A certificate that does not hold; the reason is one sentence."""


def refuse_unless(holds: Any, sentence: str) -> None:
    """Refuses a certificate unless a condition holds."""
    if not holds:
        raise RefusedError(sentence)


def is_number(value: Any) -> bool:
    """Returns whether a value is a finite number, and no truth value."""
    return type(value) in (int, float) and abs(value) <= 1e300 and math.isfinite(value)


def is_row(value: Any, count: int) -> bool:
    """Returns whether a value lists so many numbers."""
    return isinstance(value, list) and len(value) == count and all(map(is_number, value))


def read_bytes(path: Path, most: int = MOST_BYTES) -> bytes:
    """Reads a file; a device or a pipe, which may never end, is refused."""
    try:
        refuse_unless(stat.S_ISREG(path.stat().st_mode), f"{path} is no regular file")
        with path.open("rb") as stream:
            data = stream.read(most + 1)
    except (OSError, ValueError) as error:
        raise RefusedError(f"{path} cannot be read ({error})") from error
    refuse_unless(len(data) <= most, f"{path} is larger than {most} bytes")
    return data


def read_json(data: bytes) -> Any:
    """Reads JSON, without keys that are given twice and without NaN or infinities."""
    return json.loads(data.decode("ascii"), object_pairs_hook=_once, parse_constant=_refused)


def read_yaml(path: Path) -> Any:
    return parse_yaml(read_bytes(path, MOST_BYTES // 1000).decode(), path)


def parse_yaml(text: str, source: object) -> Any:
    """Reads plain values; aliases, by which a few bytes unfold to gigabytes, are refused."""
    try:
        return yaml.load(text, _Strict)
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        raise RefusedError(f"{source} is no YAML ({str(error)[:80]})") from error


class _Strict(yaml.SafeLoader):
    def compose_node(self, parent: Any, index: Any) -> Any:
        refuse_unless(not self.check_event(yaml.AliasEvent), "a file holds aliases")
        return super().compose_node(parent, index)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        _once([(self.construct_object(key, deep=True), None) for key, _ in node.value])
        return super().construct_mapping(node, deep)


def _once(pairs: list[tuple[Any, Any]]) -> dict[str, Any]:
    whole = dict(pairs)
    refuse_unless(all(isinstance(key, str) for key in whole), "a key is no text")
    refuse_unless(len(whole) == len(pairs), "a key is given twice")
    return whole


def _refused(text: str) -> None:
    raise RefusedError(f"{text} is no number")
