"""What pyproject.toml says of the packages and of the Pythons that they run on."""

import tomllib
from pathlib import Path

import pytest
import yaml
from packaging.specifiers import SpecifierSet

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


@pytest.fixture
def on_disk() -> set[str]:
    """Packages by their folders, as `glassgait.models.task`."""
    tops = PROJECT["tool"]["setuptools"]["package-dir"].values()
    initials = (found for top in tops for found in (ROOT / top).rglob("__init__.py"))
    return {".".join(("glassgait", *found.parent.relative_to(ROOT).parts)) for found in initials}


def test_every_package_ships(on_disk):
    listed = PROJECT["tool"]["setuptools"]["packages"]
    assert sorted(listed) == sorted(on_disk)


def test_every_folder_with_code_is_a_package(on_disk):
    """Without an `__init__.py` a folder would be missing above, too."""
    tops = PROJECT["tool"]["setuptools"]["package-dir"].values()
    modules = (found for top in tops for found in (ROOT / top).rglob("*.py"))
    folders = {".".join(("glassgait", *found.parent.relative_to(ROOT).parts)) for found in modules}
    assert folders == on_disk


def test_an_editor_finds_every_package_at_its_folder():
    for name, folder in PROJECT["tool"]["setuptools"]["package-dir"].items():
        link = ROOT / ".typings" / name.replace(".", "/")
        assert link.resolve() == ROOT / folder


def test_ci_runs_every_supported_python_and_no_other():
    supported = SpecifierSet(PROJECT["project"]["requires-python"])
    workflow = yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yml").read_text())
    run = workflow["jobs"]["tests"]["strategy"]["matrix"]["python"]
    assert run == [f"3.{minor}" for minor in range(100) if f"3.{minor}" in supported]
