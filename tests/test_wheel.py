"""The wheel holds all files, and its commands run in another folder."""

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import venv
from collections.abc import Callable
from pathlib import Path
from zipfile import ZipFile

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("models", "systems", "diagrams", "studies")
LARGEST = 32_000_000
"""Bytes of a wheel; PyPI takes 100 MB."""


@pytest.fixture(scope="module")
def tracked() -> list[str]:
    """Tracked files of the packages."""
    if not (ROOT / ".git").exists():
        pytest.skip("not a checkout")
    command = ["git", "-C", ROOT, "ls-files", *PACKAGES]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()


@pytest.fixture(scope="module")
def wheel(tracked, tmp_path_factory) -> Path:
    """A wheel by way of a source distribution, as PyPI gets both.

    It is built from a copy of the tracked files: a `build` folder would add old ones.
    """
    source, built = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("built")
    for name in (*tracked, "pyproject.toml", "README.md", "LICENSE"):
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, source / name)
    python("build", "--outdir", built, source)
    (path,) = built.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory) -> Callable[..., str]:
    """Runs a program of an environment that has the wheel and the dependencies, not the checkout.

    Python searches a path from a `.pth` file, but does not read the `.pth` files there: that of an
    editable install would lead to the checkout.
    """
    folder, elsewhere = tmp_path_factory.mktemp("venv"), tmp_path_factory.mktemp("elsewhere")
    venv.create(folder, with_pip=False)
    pip(folder / "bin" / "python", "install", wheel)
    paths = sysconfig.get_paths(vars={"base": str(folder), "platbase": str(folder)})
    dependencies = {sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}
    (Path(paths["purelib"]) / "dependencies.pth").write_text("\n".join(sorted(dependencies)))

    def run(program: str, *arguments: str | Path, where: Path = elsewhere) -> str:
        command = [folder / "bin" / program, *arguments]
        done = subprocess.run(
            command, cwd=where, env={}, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    for name in PACKAGES:
        origin = run("python", "-c", f"import glassgait.{name} as package; print(package.__file__)")
        assert Path(origin.strip()).is_relative_to(folder)
    return run


def pip(target: str | Path, verb: str, *arguments: str | Path) -> None:
    """Runs this environment's pip on an interpreter, without dependencies."""
    python("pip", "--python", target, verb, "--quiet", "--no-deps", *arguments)


def python(module: str, *arguments: str | Path) -> None:
    """Runs a module of this environment as a program."""
    # Packages on PYTHONPATH would count as installed.
    alone = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    command = [sys.executable, "-m", module, *arguments]
    done = subprocess.run(command, env=alone, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_every_folder_of_modules_is_a_package_of_the_project():
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]
    folders = [path.parent for name in PACKAGES for path in (ROOT / name).rglob("__init__.py")]
    names = [f"glassgait.{'.'.join(path.relative_to(ROOT).parts)}" for path in folders]
    assert sorted(listed) == sorted(names)


@pytest.mark.slow
def test_every_tracked_file_but_the_pages_and_their_pictures_is_in_the_wheel(wheel, tracked):
    pictures = r"studies/(pictures|reproduction/results)/.*\.(png|gif|svg|csv)"
    of_pages = {name for name in tracked if re.match(pictures, name)}
    pages = {name for name in tracked if Path(name).suffix == ".md" and "templates" not in name}
    of_pages -= {"studies/pictures/locomotion.svg"}  # The report shows it.
    # Beside the files that they are about, which all ship.
    of_pages |= pages - {"diagrams/scenarios/README.md"}
    names = {name for name in ZipFile(wheel).namelist() if ".dist-info/" not in name}
    assert names == {f"glassgait/{name}" for name in set(tracked) - of_pages}
    assert wheel.stat().st_size < LARGEST


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["view", "--n-steps", "25"], "stayed up after 0.50 s"),
        (["demo", "--n-robots", "2"], "page written to runs/demo/report.html"),
        (["explain", "page", "--n-steps", "50", "--step", "20"], "page written to runs/explain"),
    ],
)
def test_commands_run_from_the_wheel(installed, arguments, said):
    assert said in installed("glassgait", *arguments)
