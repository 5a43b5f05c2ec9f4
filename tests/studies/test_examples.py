"""The examples do what they say."""

import shutil
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
import tyro

from glassgait.studies.examples import stopping
from glassgait.studies.examples.train_in_gym import train


@pytest.mark.slow
def test_a_linear_policy_learns_in_gymnasiums_loop(capsys):
    before, after, expert = tyro.cli(train, args=["--seconds", "10", "--num-envs", "16"])
    assert before < 0.05
    assert 3 * before < after < expert
    assert (
        f"{before:.3f} before, {after:.3f} after, {expert:.3f} expert's" in capsys.readouterr().out
    )


def test_an_experiment_of_ones_own_runs_from_any_folder_and_resumes(tmp_path):
    script = Path(shutil.copy(stopping.__file__, tmp_path / "mine.py"))
    command = [sys.executable, script.name, "--policy", "expert", "gbm", "--n-robots", "2"]
    command += ["--n-seeds", "2"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    folder = tmp_path / "runs" / "stopping" / "trot"
    table = pd.read_csv(folder / "stopping.csv")
    assert table[["policy", "robots"]].to_numpy().tolist() == [["expert", 4], ["gbm", 4]]
    assert table["mean"].between(0.02, 2.0).all() and (table["falls"] == 0).all()
    before = (folder / "stopping.csv").read_bytes()
    (folder / "stopping.csv").unlink()
    cases = sorted((folder / "cases").iterdir())
    cases[0].unlink()
    command += ["--resume", "--n-workers", "1"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    assert (folder / "stopping.csv").read_bytes() == before
    assert sorted((folder / "cases").iterdir()) == cases
