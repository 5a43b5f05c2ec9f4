"""What pictures were drawn from: a record beside them, by which a test finds those that are old.

Pictures that are drawn from files that ship have the digests of these. Of pictures of a run that is
not kept the record says which command drew them, and when.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from glassgait.models.files import digest, write_atomically

FOLDER = Path(__file__).parent
ROOT = FOLDER.parents[1]
RECORD = FOLDER / "drawn_from.json"

KINDS = (".png", ".svg", ".gif")


def read_record() -> dict[str, dict[str, Any]]:
    """Reads the record: what each picture was drawn from, by its name."""
    return json.loads(RECORD.read_text())


def note(picture: str, command: str, inputs: Mapping[str, str]) -> None:
    """Notes what a picture was drawn from just now.

    Args:
        picture: Name of its file.
        command: What draws it.
        inputs: Digests of what it was drawn from, by their names.
    """
    whole = read_record() | {picture: {"command": command, "inputs": dict(inputs)}}
    write_record(whole)


def write_record(whole: Mapping[str, Mapping[str, Any]]) -> None:
    """Writes the record, its pictures in order."""
    write_atomically(RECORD, json.dumps(dict(sorted(whole.items())), indent=1) + "\n")


def digests(*paths: Path) -> dict[str, str]:
    """Returns the digests of files of the project, by their paths in it."""
    return {str(path.resolve().relative_to(ROOT)): digest(path) for path in sorted(paths)}


def digest_of_text(text: str) -> str:
    """Returns the digest of a text that a picture is drawn from."""
    return hashlib.sha256(text.encode()).hexdigest()
