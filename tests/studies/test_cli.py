"""The command line: what it prints, writes and refuses."""

import numpy as np
import pandas as pd
import pytest

from models.task.alternation import parse_ratio
from studies.cli import main
from studies.tables import format_cell, to_markdown


def test_bad_input_is_told_in_one_sentence(refused, tmp_path):
    unknown = "unknown gait 'gallop'; the gaits are"
    assert unknown in refused(["train", "--gait", "gallop"])
    assert unknown in refused(["gait", "gallop"])
    assert unknown in refused(["rollout", "--gait", "gallop"])
    assert "unknown policy 'oracle'" in refused(["rollout", "--policy", "oracle"])
    assert "is not an alternation ratio" in refused(["rollout", "--ratio", "2/3"])
    assert "name one with --policy" in refused(["rollout", "--ratio", "1/4"])
    assert "time_step is -0.1" in refused(["rollout", "--station.time-step", "-0.1"])
    assert "n_robots is 0" in refused(["evaluate", "--n-robots", "0"])
    assert "do not fit in n_groups" in refused(["train", "--n-groups", "2"])
    assert "divides 0.02" in refused(
        ["train", "--station.time-step", "0.015", "--output", str(tmp_path / "run")]
    )
    assert "students is empty" in refused(["distill", "--students"])
    assert "episodes is 0" in refused(["distill", "--episodes", "0"])
    assert "alone_levels is -1" in refused(["distill", "--alone-levels", "-1"])
    assert "start_weights is empty" in refused(["distill", "--symbolic.start-weights"])
    assert "start_weights is (0,)" in refused(["distill", "--symbolic.start-weights", "0"])
    assert "shape 90 64 asks" in refused(["distill", "--symbolic.shapes", "90", "64"])
    assert "worlds is empty" in refused(["evaluate", "--worlds"])
    assert "lengths is empty" in refused(["front", "--lengths"])
    assert "lengths is (8, 0)" in refused(["front", "--lengths", "8", "0"])
    assert "policies is empty" in refused(["importance", "--policies"])
    assert "repeats is 0" in refused(["importance", "--repeats", "0"])
    assert "name one gait" in refused(["evaluate", "--gait", "all", "--expert", "x"])
    assert "unknown policy 'oracle'" in refused(["evaluate", "--policy", "oracle"])
    students = ["--students", str(tmp_path)]
    assert "no student 'ebm'" in refused(["rollout", "--policy", "ebm", *students])
    assert "holds no students" in refused(["evaluate", "--policy", "students", *students])


def test_nothing_is_left_behind_by_a_refusal(refused, tmp_path):
    output = tmp_path / "run"
    refused(["train", "--gait", "gallop", "--output", str(output)])
    refused(["train", "--resume", "--output", str(output)])
    assert not output.exists()


def test_gait_command_draws_the_machine(capsys, tmp_path):
    main(["gait", "trot"])
    assert "q0 --> q1: FL & RR & ~FR & ~RL" in capsys.readouterr().out
    path = tmp_path / "trot.dot"
    main(["gait", "trot", "--format", "graphviz", "--output", str(path)])
    assert path.read_text().startswith("digraph")


def test_evaluate_writes_its_tables(tmp_path):
    small = ["--n-robots", "2", "--n-steps", "60", "--n-seeds", "1", "--worlds", "training"]
    main(["evaluate", *small, "--output", str(tmp_path)])
    tables = {
        f"{name}.{kind}" for name in ("robots", "scorecard", "falls") for kind in ("csv", "md")
    }
    written = {path.name for path in tmp_path.iterdir()}
    assert written == {"config.yaml", "metrics.json", "rollouts"} | tables


def test_rollout_writes_replay_and_gait_diagram(tmp_path, capsys):
    main(["rollout", "--seconds", "0.5", "--output", str(tmp_path)])
    assert {path.suffix for path in tmp_path.iterdir()} == {".html", ".png", ".pdf"}
    assert "stayed up after 0.50 s" in capsys.readouterr().out


def test_train_refuses_to_overwrite_a_run(tmp_path, refused):
    small = ["--updates", "1", "--n-robots", "4", "--n-groups", "1"]
    small += ["--payloads", "--fine-steps"]
    run = ["train", *small, "--output", str(tmp_path)]
    main(run)
    assert "continue it with --resume" in refused(run)
    assert (tmp_path / "trot.safetensors").exists()


@pytest.mark.parametrize(("text", "period"), [("1", 1), ("1/4", 4), ("0", 0), ("0.5", 2)])
def test_ratios(text, period):
    assert parse_ratio(text) == period


def test_cells_and_markdown():
    assert [format_cell(x) for x in (np.nan, 0.0123, 3.14159, 1234.5, "a", 3)] == [
        "–", "0.0123", "3.142", "1,234", "a", "3",
    ]  # fmt: skip
    table = to_markdown(pd.DataFrame({"a": [1], "b": [0.5]}))
    assert table == "| a | b |\n| --- | --- |\n| 1 | 0.500 |\n"
