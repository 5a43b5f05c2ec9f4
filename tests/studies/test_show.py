"""The command that prints formulas."""

from pathlib import Path

import pytest

from glassgait.models.formulas.reader import read_formulas
from glassgait.models.policies.library import STUDENT_DIRECTORY, load_expert
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.task.gait import GAIT_DIRECTORY
from glassgait.studies.cli import main


def test_the_file_that_ships_is_printed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    main(["explain", "formulas", "--gait", "trot"])
    printed = capsys.readouterr().out
    text = (STUDENT_DIRECTORY / "trot" / "sparse_formula.formulas").read_text()
    assert printed.startswith(text)
    assert "# Page of formulas: 400 terms in 12 formulas" in printed
    assert read_formulas(printed) == read_formulas(text)


def test_a_joints_lines_are_printed_alone(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    own = ["--robot", "go2", "--gait", "bound", "--policy", "statewise_symbolic"]  # no mirror
    main(["explain", "formulas", *own, "--joint", "RL_calf"])
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if line.startswith("state")] == ["state 0", "state 1"]
    joints = [line.split(" ")[0] for line in lines if " = " in line and line[0] != " "]
    assert joints == ["RL_calf"] * 2


def test_a_file_of_ones_own_is_printed_and_refused_by_its_lines(tmp_path, capsys, refused):
    text = (STUDENT_DIRECTORY / "trot" / "symbolic.formulas").read_text()
    own = tmp_path / "mine.formulas"
    own.write_text(text.replace("cmd.v", "cmd.v", 1))
    main(["explain", "formulas", "--gait", "trot", "--policy", str(own)])
    assert capsys.readouterr().out.startswith(text)
    number = next(i for i, line in enumerate(text.splitlines(), 1) if line.startswith("RR_calf"))
    own.write_text(text.replace("\nRR_calf = ", "\nRR_calf = 2*q.RR_knee + "))
    printed = refused(["explain", "formulas", "--gait", "trot", "--policy", str(own)])
    assert f"{own}: line {number}, column 13: nothing is called 'q.RR_knee'" in printed


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--policy", "gbm"], "--policy gbm"),
        (["--joint", "FL_knee"], "unknown joint 'FL_knee'"),
        (["--policy", "mine.formula"], "ending in .safetensors or .formulas"),
        (["--policy", "mine.formulas"], "mine.formulas"),
    ],
)
def test_bad_input_is_refused(arguments, message, tmp_path, monkeypatch, refused):
    monkeypatch.chdir(tmp_path)
    assert message in refused(["explain", "formulas", "--gait", "trot", *arguments])


@pytest.fixture
def hop(tmp_path, monkeypatch):
    """A gait of one's own, with the files that train and distill leave by default."""
    monkeypatch.chdir(tmp_path)
    expert = load_expert("trot")
    own = NeuralPolicy.from_arrays(
        *expert.to_arrays(), gait="hop", observation_names=expert.observation_names
    )
    own.save(Path("runs/train/hop/hop.safetensors"))
    text = (STUDENT_DIRECTORY / "trot" / "symbolic.formulas").read_text()
    student = Path("runs/distill/hop/symbolic.formulas")
    student.parent.mkdir(parents=True)
    student.write_text(text.replace("gait: trot", "gait: hop"))
    Path("hop.yaml").write_text((GAIT_DIRECTORY / "trot.yaml").read_text())
    return student


def test_what_was_trained_and_distilled_here_is_found_where_nothing_ships(hop, capsys):
    main(["explain", "formulas", "--gait", "hop.yaml"])
    printed = capsys.readouterr()
    # What was chosen stands beside the file, not in it.
    assert printed.out.startswith(hop.read_text())
    assert "policies are those of runs/distill/hop" in printed.err
    assert "the expert runs/train/hop" in printed.err


def test_one_robot_walks_by_what_was_trained_here(hop, capsys):
    main(["view", "--gait", "hop.yaml", "--n-steps", "10"])
    printed = capsys.readouterr()
    assert "stayed up after 0.20 s" in printed.out
    assert "the expert runs/train/hop" in printed.err
    Path("runs/train/hop/hop.safetensors").unlink()
    with pytest.raises(SystemExit):
        main(["view", "--gait", "hop.yaml", "--n-steps", "10"])
    printed = capsys.readouterr()
    assert "inputs.expert" in printed.out + printed.err


def test_what_ships_is_taken_and_named(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    main(["explain", "formulas", "--gait", "trot", "--joint", "FL_hip"])
    assert capsys.readouterr().err == "· trot: policies are those that ship\n"
