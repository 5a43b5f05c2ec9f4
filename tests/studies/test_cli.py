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
    assert "students is empty" in refused(["distill", "--students"])
    assert "episodes is 0" in refused(["distill", "--episodes", "0"])
    assert "alone_rounds is -1" in refused(["distill", "--alone-rounds", "-1"])
    assert "start_weights is empty" in refused(["distill", "--symbolic.start-weights"])
    assert "start_weights is (0,)" in refused(["distill", "--symbolic.start-weights", "0"])
    assert "shape 90 64 asks" in refused(["distill", "--symbolic.shapes", "90", "64"])
    assert "scenario is empty" in refused(["evaluate", "scenarios", "--scenario"])
    assert "terms is empty" in refused(["distill", "--sweep", "terms", "--terms"])
    assert "terms is (8, 0)" in refused(["distill", "--sweep", "terms", "--terms", "8", "0"])
    assert "repeats is 0" in refused(["importance", "--repeats", "0"])
    assert "--gait" in refused(["evaluate", "scenarios", "--gait", "all", "--source", "x"])
    assert "oracle" in refused(["evaluate", "scenarios", "--policy", "oracle"])
    assert "holds no policies" in refused(["view", "--source", str(tmp_path)])
    assert "--source" in refused(["evaluate", "alternation", "--source", str(tmp_path)])


TOO_MANY = "it must be of 100 values at most"

REFUSED = {
    "train --n-robots 0": "n_robots is 0; it must be greater than or equal to 1",
    "train --n-robots 4": "n_robots is 4, fewer than n_groups = 16",
    "train --updates -3": "updates is -3; it must be greater than or equal to 1",
    "train --seed -1": "seed is -1; it must be greater than or equal to 0",
    "train --seed 4294967296": "seed is 4294967296; it must be less than",
    "train --friction-updates 0": "friction_updates is 0",
    "train --checkpoint-updates 0": "checkpoint_updates is 0",
    "train --groups.payload -1 2": "payload is (-1.0, 2.0); it must be greater than or equal to 0",
    "train --groups.gains 0.8 nan": "gains is (0.8, nan); it must be a finite number",
    "train --groups.motor-strength 1.2 0.8": "it must be the least, then the greatest",
    "train --fine-steps 0": "fine_steps is (0.0,); it must be greater than 0",
    "train --fine-steps 0.02": "name steps that are shorter than the station's",
    "train --curriculum.initial-difficulty 0": "initial_difficulty is 0.0",
    "train --curriculum.rise -0.1": "rise is -0.1; it must be greater than or equal to 0",
    "train --ppo.num-minibatches 0": "num_minibatches is 0",
    "train --ppo.num-minibatches 7000": "does not fill 7000 num_minibatches",
    "train --ppo.clip 0": "clip is 0.0; it must be greater than 0",
    "train --ppo.gamma 1.1": "gamma is 1.1; it must be less than or equal to 1",
    "train --ppo.learning-rate inf": "learning_rate is inf; it must be a finite number",
    "train --ppo.learning-rate 1e300": "learning_rate is 1e+300",
    "train --estimator.learning-rate 2": "learning_rate is 2.0; it must be less than or equal to 1",
    "train --ppo.actor-layers 2000000000": "it must be less than or equal to 4096",
    "train --ppo.critic-layers 4097": "it must be less than or equal to 4096",
    f"train --estimator.layers {'8 ' * 17}": "it must be of 16 values at most",
    f"train --fine-steps {'0.001 ' * 101}": TOO_MANY,
    f"train --fine-steps {'0.005 ' * 101}": TOO_MANY,
    f"distill --speeds {'0.5 ' * 101}": TOO_MANY,
    f"distill --symbolic.shapes {'9 9 ' * 101}": TOO_MANY,
    f"reproduce report --gait {' '.join(f'a{i}' for i in range(101))}": TOO_MANY,
    "train --ppo.initial-std 0": "initial_std is 0.0; it must be greater than 0",
    "train --ppo.kl-decay 1400 1300": "it must be the least, then the greatest",
    "train --ppo.actor-layers": "actor_layers is empty; name one or more",
    "train --estimator.layers 0": "layers is (0,); it must be greater than or equal to 1",
    "train --estimator.epochs 0": "epochs is 0",
    "distill --episodes 2 --alone-rounds 0": "of fewer than 5 episodes none is held out",
    "distill --episode-steps 1": "episode_steps is 1; it must be greater than or equal to 2",
    "distill --speeds nan": "speeds is (nan,); it must be a finite number",
    "distill --speeds -3": "name speeds of the trot from -1.0 to 1.0 m/s",
    "distill --students linear linear": "it must be a list that names nothing twice",
    "distill --n-workers 0": "it must be greater than or equal to 1, or -1",
    "distill --gbm.n-trees 0": "n_trees is 0",
    "distill --gbm.depth 40": "depth is 40; it must be less than or equal to 16",
    "distill --gbm.subsample 0": "subsample is 0.0; it must be greater than 0",
    "distill --gbm.feature-share 1.5": "feature_share is 1.5; it must be less than or equal to 1",
    "distill --histogram-gbm.leaves 1": "leaves is 1; it must be greater than or equal to 2",
    "distill --ebm.max-bins 2": "max_bins is 2; it must be greater than or equal to 3",
    "distill --ebm.max-bins 8": "max_interaction_bins is 16, more than max_bins = 8",
    "distill --ebm.outer-bags 0": "outer_bags is 0",
    "distill --ebm.interactions -1": "interactions is -1; it must be greater than or equal to 0",
    "distill --ebm.learning-rate 0": "learning_rate is 0.0; it must be greater than 0",
    "distill --symbolic.max-length 6": "max_length is 6; it must be greater than or equal to 7",
    "distill --symbolic.population 1": "population is 1; it must be greater than or equal to 2",
    "distill --symbolic.max-samples 0": "max_samples is 0",
    "distill --symbolic.generations 0": "generations is 0",
    "evaluate scenarios --n-steps 0": "n_steps is 0",
    "evaluate scenarios --seed -1": "seed is -1; it must be greater than or equal to 0",
    "evaluate scenarios --speed-range 1 0": "it must be the least, then the greatest",
    "evaluate scenarios --speed-range 0 inf": "it must be a finite number",
    "evaluate scenarios --speed-range 0 50": "name speeds of the trot from -1.0 to 1.0 m/s",
    "evaluate scenarios --scenario training training": "it must be a list that names nothing twice",
    "evaluate scenarios --n-robots 0": "n_robots is 0; it must be greater than or equal to 1",
    "importance --n-samples 1": "n_samples is 1; it must be greater than or equal to 2",
    "reproduce report --gait trot trot": "it must be a list that names nothing twice",
    "reproduce report --gait": "gait is empty; name one or more",
    "demo --n-robots -1": "n_robots is -1",
    "reproduce benchmark --repeats 0": "repeats is 0",
    "reproduce benchmark --gym-steps 0": "gym_steps is 0",
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
    for name, start in (
        ("trot.dot", "digraph"),
        ("trot.gv", "digraph"),
        ("trot.mmd", "stateDiagram-v2"),
        ("trot.md", "```mermaid\nstateDiagram-v2"),
    ):
        main(["gait", "trot", "--output", str(tmp_path / name)])
        assert (tmp_path / name).read_text().startswith(start)


def test_gait_command_writes_no_drawing_under_a_false_name(refused, tmp_path):
    picture = ["gait", "trot", "--output", str(tmp_path / "trot.svg")]
    assert "run 'dot -Tsvg' on it" in refused(picture)
    assert not list(tmp_path.iterdir())


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
