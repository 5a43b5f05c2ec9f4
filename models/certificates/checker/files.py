"""Reads regular files up to a size."""

import json
import stat
from pathlib import Path
from typing import Any

MOST_BYTES = 10_000_000


class RefusedError(Exception):
    """A certificate that does not hold; the reason is one sentence."""


def refuse_unless(holds: Any, sentence: str) -> None:
    """Refuses a certificate unless a condition holds."""
    if not holds:
        raise RefusedError(sentence)


def read_bytes(path: Path) -> bytes:
    """Reads a file; refuses devices and pipes, which may never end."""
    refuse_unless(stat.S_ISREG(path.stat().st_mode), f"{path} is not a regular file")
    with path.open("rb") as stream:
        data = stream.read(MOST_BYTES + 1)
    refuse_unless(len(data) <= MOST_BYTES, f"{path} is larger than {MOST_BYTES} bytes")
    return data


def read_json(path: Path) -> Any:
    """Reads JSON without duplicate keys."""

    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        refuse_unless(len(dict(pairs)) == len(pairs), f"{path}: a key is given twice")
        return dict(pairs)

    return json.loads(read_bytes(path).decode("ascii"), object_pairs_hook=once)
