"""The examples and the notebooks run, and what they print is true."""

import json
import re
import runpy
import shutil
from pathlib import Path

import numpy as np
import pytest

import glassgait.diagrams
from glassgait.models.policies.library import STUDENT_DIRECTORY

ROOT = Path(glassgait.diagrams.__file__).parents[1]
EXAMPLES = ROOT / "studies" / "examples"

PAGES = sorted(ROOT.glob("**/README.md"))
RECIPES = [
    pytest.param(block, id=f"{page.parent.name}-{number}")
    for page in PAGES
    for number, block in enumerate(
        re.findall(r"```python\n(.*?)```", page.read_text("utf-8"), re.DOTALL)
    )
]


@pytest.fixture
def printed(capsys, monkeypatch):
    """Runs an example as a script, and returns the numbers that it prints by a pattern."""

    def run(name, pattern):
        monkeypatch.setattr("sys.argv", [name])
        runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
        found = re.findall(pattern, capsys.readouterr().out)
        return np.array(found, dtype=float)

    return run


def test_a_hand_written_policy_trots(printed):
    speeds = printed("own_policy", r"robot \d: (\S+) m/s")
    assert len(speeds) == 3 and np.all(np.abs(speeds - 0.36) < 0.1)


@pytest.mark.parametrize("recipe", RECIPES)
def test_an_example_of_a_page_runs_and_its_robot_stays_up(recipe, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(STUDENT_DIRECTORY / "trot" / "formulas.formulas", "mine.formulas")
    names = {}
    exec(recipe, names)
    if "rollout" in names:
        assert not names["rollout"].failed
    if "falls" in names:
        falls = names["falls"].tolist()
        assert falls[1] == 0 and falls == sorted(falls)
    if "Planner" in names:
        assert np.linalg.norm(names["rollout"]["state"][-1, 4:6] - [2.0, 1.5]) < 0.5


def test_every_example_is_found():
    assert len(RECIPES) >= 14


@pytest.mark.slow
def test_an_experiment_of_your_own_runs_from_any_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arguments = ["--policy", "expert", "--n-robots", "2", "--n-seeds", "2"]
    monkeypatch.setattr("sys.argv", ["stopping", *arguments])
    runpy.run_path(str(EXAMPLES / "stopping.py"), run_name="__main__")
    (table,) = tmp_path.rglob("stopping.csv")
    assert "expert" in table.read_text()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "shown"), [("alternation", ["png"]), ("distil_and_edit", ["text/latex", "refuted:"])]
)
def test_a_notebook_runs_and_holds_what_it_shows(name, shown, tmp_path):
    nbformat = pytest.importorskip("nbformat", reason="needs nbformat (the dev extra)")
    nbclient = pytest.importorskip("nbclient", reason="needs nbclient (the dev extra)")
    notebook = nbformat.read(EXAMPLES / f"{name}.ipynb", as_version=4)
    saved = json.dumps([cell.get("outputs", []) for cell in notebook["cells"]])
    resources = {"metadata": {"path": str(tmp_path)}}
    nbclient.NotebookClient(notebook, timeout=600, resources=resources).execute()
    computed = json.dumps([cell.get("outputs", []) for cell in notebook["cells"]])
    assert all(word in saved and word in computed for word in shown)
