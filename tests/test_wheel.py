"""What a wheel holds, and that the commands run from one, installed, in another folder."""

import os
import shutil
import subprocess
import sys
import sysconfig
import venv
from collections.abc import Callable
from pathlib import Path
from zipfile import ZipFile

import pytest

from glassgait.models.task.gait import load_gait
from glassgait.studies.common.policies import find_policies
from glassgait.studies.distillation.students import default_student

ROOT = Path(__file__).parents[1]
PACKAGES = ("models", "systems", "diagrams", "studies")
OWN = ("models/__init__.py", "models/files.py", "diagrams/__init__.py", "models.py")
"""Files of a person who gives their modules the names that the folders have here."""
LARGEST = 32_000_000
"""Bytes of a wheel; PyPI takes 100 MB."""

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def tracked() -> list[str]:
    """Files of the packages that git knows."""
    if not (ROOT / ".git").exists():
        pytest.skip("not a checkout")
    command = ["git", "-C", ROOT, "ls-files", *PACKAGES]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()


@pytest.fixture(scope="module")
def wheel(tracked, tmp_path_factory) -> Path:
    """A wheel by way of a source distribution, as PyPI gets both.

    It is of a copy of the tracked files: a `build` folder would add old ones.
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

    A path in a `.pth` file is searched, but its own `.pth` files are not read, among them the one
    by which an editable install finds the checkout.
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
    # What a path variable names would pass for installed.
    alone = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    command = [sys.executable, "-m", module, *arguments]
    done = subprocess.run(command, env=alone, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def top_names(wheel: Path) -> set[str]:
    """What a wheel puts into `site-packages`."""
    return {name.partition("/")[0] for name in ZipFile(wheel).namelist()}


def test_every_tracked_file_but_the_pages_and_their_pictures_is_in_the_wheel(wheel, tracked):
    of_pages = {
        name
        for name in tracked
        if name.startswith("studies/pictures/") and Path(name).suffix in (".png", ".gif", ".svg")
    }
    pages = {name for name in tracked if Path(name).suffix == ".md" and "templates" not in name}
    of_pages -= {"studies/pictures/locomotion.svg"}  # The report shows it.
    # Beside the files that they are about, which all ship.
    of_pages |= pages - {"diagrams/scenarios/README.md"}
    names = {name for name in ZipFile(wheel).namelist() if ".dist-info/" not in name}
    assert names == {f"glassgait/{name}" for name in set(tracked) - of_pages}
    assert wheel.stat().st_size < LARGEST


def test_a_gait_is_checked_from_the_wheel(installed):
    assert "s0 --> s1" in installed("glassgait", "gait", "trot")


def test_the_expert_is_rolled_out_from_the_wheel(installed):
    assert "stayed up after 0.50 s" in installed("glassgait", "view", "--n-steps", "25")


def test_modules_of_a_user_do_not_pass_for_the_wheels(installed, tmp_path):
    for name in OWN:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("raise ImportError('of ones own')")
    # Unlike the installed command, `-m` searches the folder it is called in first.
    program = ("python", "-m", "glassgait.studies.cli")
    reported = installed(*program, "view", "--n-steps", "25", where=tmp_path)
    assert "stayed up after 0.50 s" in reported


def test_pypis_diagrams_may_be_installed_beside_the_wheel(wheel, tmp_path):
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--dest", tmp_path]
    done = subprocess.run([*command, "diagrams"], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        pytest.skip(f"PyPI gave no diagrams: {done.stderr.strip().splitlines()[-1]}")
    (other,) = tmp_path.glob("*.whl")
    assert "diagrams" in top_names(other)
    assert top_names(other).isdisjoint(top_names(wheel))


@pytest.mark.parametrize("gait", ["trot", "bound"])
def test_a_shipped_student_is_explained_from_the_wheel(installed, gait):
    reported = installed(
        "glassgait", "explain", "page", "--gait", gait, "--n-steps", "50", "--step", "20"
    )
    kind = default_student(find_policies(load_gait(gait)))
    assert f"page written to runs/explain/page/{gait}/{kind}/index.html" in reported


def test_the_report_is_written_from_the_wheel(installed, tmp_path):
    tests = shutil.copytree(ROOT / "tests", tmp_path / "tests")
    own = tests / "studies" / "test_report.py"
    reported = installed("python", "-m", "pytest", "--import-mode=importlib", "-m", "slow", own)
    assert "1 passed" in reported
