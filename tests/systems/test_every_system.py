"""Every leaf system has a test file of its own."""

from pathlib import Path

import glassgait.systems

SYSTEMS = Path(glassgait.systems.__file__).parent


def test_every_system_has_its_test_file():
    names = {path.stem for path in SYSTEMS.glob("*.py")} - {"__init__"}
    tested = {path.stem.removeprefix("test_") for path in Path(__file__).parent.glob("test_*.py")}
    assert names - tested == set()
    assert tested - names == {"every_system"}
