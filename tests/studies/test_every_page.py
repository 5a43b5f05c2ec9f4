"""Every page that a command writes can be read: on a telephone, by keys, and by those who hear it.

The reports of `demo` and `reproduce` are looked at where they are made, in their own tests.
"""

import re
from pathlib import Path

import pytest

import glassgait.studies
from glassgait.models.policies.library import STUDENT_DIRECTORY
from glassgait.studies.cli import main

STUDIES = Path(glassgait.studies.__file__).parent

TROT = ["--gait", "trot", "--policy"]

COMMANDS = {
    "explained formulas": ["explain", "page", *TROT, "sparse_formula", "--n-steps", "40"],
    "explained additive model": ["explain", "page", *TROT, "ebm", "--n-steps", "40"],
    "explained linear laws": ["explain", "page", *TROT, "statewise_linear", "--n-steps", "40"],
    "replay": ["view", *TROT, "sparse_formula", "--n-steps", "20"],
}
"""What writes each kind of page, in short."""

PAGES = {
    "replay": "sparse_formula_alone.html",
}
"""Names of pages; of others it is index.html."""

ELSEWHERE = {
    "evaluation/pair.py": "a replay of two",
    "reproduction/demo.py": "test_demo.py",
    "reproduction/page.py": "test_demo.py and test_report.py",
    "reproduction/report.py": "test_report.py",
}
"""Files that name a page which is looked at elsewhere, or none of their own."""

HERE = {
    "cli.py",
    "common/pages.py",
    "explanation/command.py",
    "explanation/page.py",
    "view/command.py",
}


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Returns a function that writes a kind of page, once, and returns its path."""
    folders: dict[str, Path] = {}

    def write(kind: str) -> Path:
        if kind not in folders:
            folders[kind] = tmp_path_factory.mktemp("page")
            main([*COMMANDS[kind], "--output", str(folders[kind])])
        return folders[kind] / PAGES.get(kind, "index.html")

    return write


@pytest.mark.slow
@pytest.mark.parametrize("kind", COMMANDS)
def test_a_page_can_be_read(kind, written, faults_of):
    assert faults_of(written(kind)) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    "page", sorted(STUDENT_DIRECTORY.rglob("*.html")), ids=lambda path: path.parent.name
)
def test_a_page_that_ships_can_be_read(page, faults_of):
    assert faults_of(page) == []


def test_no_command_writes_a_page_that_is_not_looked_at():
    named = {
        path.relative_to(STUDIES).as_posix()
        for path in STUDIES.rglob("*.py")
        if re.search(r"\.html\b", path.read_text()) and "studio" not in path.parts
    }
    assert named == HERE | {*ELSEWHERE}
