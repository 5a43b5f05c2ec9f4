"""The command line: what it prints, writes and refuses."""

import numpy as np
import pandas as pd
import pytest

from glassgait.models.task.alternation import parse_ratio
from glassgait.studies.cli import COMMANDS, command_class, main
from glassgait.studies.common.run_folder import default_folder
from glassgait.studies.common.tables import format_cell, to_markdown


def test_bad_input_is_refused_in_one_sentence(refused, tmp_path):
    unknown = "unknown gait 'gallop'; the gaits are"
    assert unknown in refused(["train", "--gait", "gallop"])
    assert unknown in refused(["gait", "gallop"])
    assert unknown in refused(["view", "--gait", "gallop"])
    assert "--policy 'oracle'" in refused(["view", "--policy", "oracle"])
    assert "is not an alternation ratio" in refused(["view", "--ratio", "2/3"])
    assert "name one with --policy" in refused(["view", "--ratio", "1/4"])
    assert "time_step is -0.1" in refused(["train", "--station.time-step", "-0.1"])
    assert "n_robots is 0" in refused(["evaluate", "scenarios", "--n-robots", "0"])
    assert "do not fit in n_groups" in refused(
        ["train", "--n-groups", "1", "--fine-steps", "0.005", "0.0025"]
    )
    assert "must divide the control period" in refused(
        ["train", "--station.time-step", "0.015", "--output", str(tmp_path / "run")]
    )
    assert "shape 90 64 asks" in refused(["distill", "--symbolic.shapes", "90", "64"])
    assert "--gait" in refused(["evaluate", "scenarios", "--gait", "all", "--source", "x"])
    assert "oracle" in refused(["evaluate", "scenarios", "--policy", "oracle"])
    assert "holds no policies" in refused(["view", "--source", str(tmp_path)])
    assert "--source" in refused(["evaluate", "alternation", "--source", str(tmp_path)])


REFUSED = {
    "train --n-robots 0": "n_robots is 0; it must be greater than or equal to 1",
    "train --n-robots 4": "n_robots is 4, fewer than n_groups = 16",
    "train --groups.payload -1 2": "groups: payload[0] is -1.0",
    "train --groups.motor-strength 1.2 0.8": "it must be the least, then the greatest",
    "train --fine-steps 0.02": "name steps that are shorter than the station's",
    f"train --fine-steps {'0.001 ' * 101}": "must have at most 100 items",
    "train --ppo.num-minibatches 7000": "does not fill 7000 num_minibatches",
    "train --ppo.learning-rate inf": "learning_rate is inf; it must be a finite number",
    "distill --episodes 2 --alone-rounds 0": "of fewer than 5 episodes none is held out",
    "distill --speeds -3": "name speeds of the trot from -1.0 to 1.0 m/s",
    "distill --students linear linear": "it must be a list that names nothing twice",
    "distill --students": "must have at least 1 item",
    "distill --n-workers 0": "it must be 1 or more, or -1",
    "distill --gbm.depth 40": "depth is 40; it must be less than or equal to 16",
    "distill --ebm.max-bins 8": "max_interaction_bins is 16, more than max_bins = 8",
    "evaluate scenarios --speed-range 0 50": "name speeds of the trot from -1.0 to 1.0 m/s",
    "importance --n-samples 1": "n_samples is 1; it must be greater than or equal to 2",
    "demo --n-robots -1": "n_robots is -1",
}


@pytest.mark.parametrize("command", REFUSED)
def test_refuses_settings_out_of_range(command, refused, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert REFUSED[command] in refused(command.split())
    assert not list(tmp_path.iterdir())


def test_nothing_is_left_behind_by_a_refusal(refused, tmp_path):
    output = tmp_path / "run"
    refused(["train", "--gait", "gallop", "--output", str(output)])
    refused(["train", "--station.time-step", "0.015", "--output", str(output)])
    assert not output.exists()


def test_gait_command_draws_the_machine(capsys, tmp_path):
    main(["gait", "trot"])
    assert "s0 --> s1: FL & RR & ~FR & ~RL" in capsys.readouterr().out
    main(["gait", "trot", "--output", str(tmp_path / "trot.md")])
    assert (tmp_path / "trot.md").read_text().startswith("```mermaid\nstateDiagram-v2")


def test_evaluate_writes_its_tables(tmp_path, capsys):
    small = ["--n-robots", "2", "--n-steps", "60", "--policy", "expert", "--scenario", "training"]
    main(["evaluate", "scenarios", *small, "--output", str(tmp_path)])
    message = " ".join(capsys.readouterr().out.split())
    assert (
        "drawn speeds below 0.2 m/s are commands to stand, which the speed error leaves" in message
    )
    tables = {
        f"{name}.{kind}" for name in ("robots", "scorecard", "falls") for kind in ("csv", "md")
    }
    written = {path.name for path in tmp_path.iterdir() if not path.name.startswith(".")}
    assert written == {"config.yaml", "metrics.json", "cases"} | tables


def test_rollout_writes_replay_and_gait_diagram(tmp_path, capsys):
    main(["view", "--n-steps", "25", "--output", str(tmp_path)])
    assert {path.suffix for path in tmp_path.iterdir()} == {".html", ".png", ".pdf", ".yaml"}
    assert "stayed up after 0.50 s" in capsys.readouterr().out


def test_train_refuses_to_overwrite_a_run(tmp_path, refused):
    small = ["--updates", "1", "--n-robots", "4", "--n-groups", "1"]
    small += ["--fine-steps"]
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


@pytest.mark.parametrize(
    "name", [name for name in COMMANDS if name not in ("gait", "reproduce paper")]
)
def test_errors_and_folders_call_a_command_by_its_words(name):
    assert command_class(name).title == name
    assert default_folder(name).parts == ("runs", *name.replace("--", "").split())
