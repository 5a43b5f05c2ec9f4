"""The examples and the notebooks run, and what they print is true."""

import json
import re
import runpy
from pathlib import Path

import numpy as np
import pytest
import tyro

from glassgait.studies.examples import build_and_log, planner
from glassgait.studies.examples.train_in_gym import train

EXAMPLES = Path(build_and_log.__file__).parent


@pytest.fixture
def printed(capsys, monkeypatch):
    """Runs an example as a script, and returns the numbers that it prints by a pattern."""

    def run(name, pattern):
        monkeypatch.setattr("sys.argv", [name])
        runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
        found = re.findall(pattern, capsys.readouterr().out)
        return np.array(found, dtype=float)

    return run


def test_logged_robots_keep_nearly_to_the_command(printed):
    speeds = printed("build_and_log", r"robot \d: (\S+) m/s")
    assert len(set(speeds)) == 3
    assert np.all(np.abs(speeds - 0.5) < 0.1)


def test_a_hand_written_policy_trots(printed):
    ((time, ahead, aside, height),) = printed(
        "own_policy", r"after (\S+) s: (\S+) m.* (\S+) m.* (\S+) m"
    )
    assert time == 5.0
    assert ahead > 1.0
    assert abs(aside) < 0.5
    assert height > 0.2


def test_the_planner_sends_the_robot_to_its_goal(printed):
    ((time, x, y),) = printed("planner", r"after (\S+) s at (\S+) m, (\S+) m")
    assert time == 10.0
    assert np.hypot(x - planner.GOAL[0], y - planner.GOAL[1]) < 0.5


@pytest.mark.slow
def test_harder_pushes_make_more_robots_fall(printed):
    rows = printed("push_robots", r"(\S+) m/s: (\d+) of 8 fall, (\S+) degrees")
    speeds, falls, degrees = rows.T
    assert speeds.tolist() == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert falls.tolist() == sorted(falls)
    assert falls[1] == 0.0
    assert degrees[1] > degrees[0] > 0.0


@pytest.mark.slow
def test_a_linear_policy_learns_in_gymnasiums_loop():
    before, after, expert = tyro.cli(train, args=["--seconds", "10", "--num-envs", "16"])
    assert before < 0.05
    assert 3 * before < after < expert


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
    ("name", "shown"), [("distil_and_read", "text/latex"), ("edit_and_verify", "refuted")]
)
def test_a_notebook_runs(name, shown, tmp_path):
    nbformat = pytest.importorskip("nbformat", reason="needs nbformat (the dev extra)")
    nbclient = pytest.importorskip("nbclient", reason="needs nbclient (the dev extra)")
    notebook = nbformat.read(EXAMPLES / f"{name}.ipynb", as_version=4)
    client = nbclient.NotebookClient(
        notebook, timeout=600, resources={"metadata": {"path": str(tmp_path)}}
    )
    client.execute()
    assert shown in json.dumps([cell.get("outputs", []) for cell in notebook["cells"]])
