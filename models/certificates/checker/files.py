"""Reading what is checked: regular files up to a size, and JSON that says everything once."""

import json
import stat
from pathlib import Path
from typing import Any

import yaml

from .robot import RefusedError, refuse_unless

MOST_BYTES = 100_000_000
"""Greatest size of a certificate or a policy; a gait's file is a thousandth of it at most."""


def read_bytes(path: Path, most: int = MOST_BYTES) -> bytes:
    """Reads a file; a device or a pipe, which may never end, is refused.

    Raises:
        RefusedError: if it is none, is larger, or cannot be read.
    """
    try:
        refuse_unless(stat.S_ISREG(path.stat().st_mode), f"{path} is no regular file")
        with path.open("rb") as stream:
            data = stream.read(most + 1)
    except (OSError, ValueError) as error:
        raise RefusedError(f"{path} cannot be read ({error})") from error
    refuse_unless(len(data) <= most, f"{path} is larger than {most} bytes")
    return data


def read_json(data: bytes) -> Any:
    """Reads JSON, without keys that are given twice and without numbers that are none."""
    return json.loads(data.decode("ascii"), object_pairs_hook=_once, parse_constant=_refused)


def read_yaml(path: Path) -> Any:
    """Reads plain values; aliases, which unfold to gigabytes, are refused."""
    data = read_bytes(path, MOST_BYTES // 1000)
    named = any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(data))
    refuse_unless(not named, f"{path} holds aliases")
    return yaml.load(data, _Strict)


class _Strict(yaml.SafeLoader):
    """Plain values, each key once: of two the last would count, and a reader sees the first."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]
        refuse_unless(len(keys) == len({*keys}), "a key is given twice")
        return super().construct_mapping(node, deep)


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    whole = dict(pairs)
    refuse_unless(len(whole) == len(pairs), "a key is given twice")
    return whole


def _refused(text: str) -> None:
    raise RefusedError(f"{text} is no number")
