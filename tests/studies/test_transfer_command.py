"""`glassgait transfer`: policies of one robot, written anew for another."""

from pathlib import Path

import pandas as pd
import yaml

from glassgait.models.policies.library import load_expert, load_policy, load_student
from glassgait.models.robots.library import load_robot
from glassgait.studies.cli import main

FEW = ["--n-robots", "2", "--n-steps", "50", "--n-seeds", "1"]


def test_another_robot_walks_by_what_is_written(tmp_path, monkeypatch, own_robot, capsys):
    monkeypatch.chdir(tmp_path)
    main(["transfer", "--robot", own_robot, "--gait", "trot"])
    folder = Path("runs/transfer/mine/trot")
    assert str(folder) in capsys.readouterr().out
    robot = load_robot(own_robot)
    expert = load_expert("trot", folder / "trot.safetensors", robot)
    page = load_policy(folder / "sparse_formula.formulas", robot)
    assert expert.robot is page.robot is robot
    record = yaml.safe_load((folder / "config.yaml").read_text())
    assert record["inputs"]["expert"] == expert.digest()
    walked = ["--robot", own_robot, "--source", str(folder), "--policy", "sparse_formula"]
    main(["evaluate", "worlds", *walked, "--scenario", "training", *FEW, "--output", "seen"])
    assert len(pd.read_csv("seen/robots.csv")) == 2


def test_refuses_the_robot_whose_policies_are_taken_and_a_folder_that_holds_a_run(
    tmp_path, monkeypatch, own_robot, refused
):
    monkeypatch.chdir(tmp_path)
    assert "--robot a1" in refused(["transfer", "--robot", "a1"])
    main(["transfer", "--robot", own_robot, "--gait", "trot", "--output", "mine"])
    assert "mine" in refused(["transfer", "--robot", own_robot, "--output", "mine"])


def test_refuses_a_folder_that_holds_a_run_before_anything_is_written(
    tmp_path, monkeypatch, own_robot, refused
):
    monkeypatch.chdir(tmp_path)
    main(["transfer", "--robot", own_robot, "--gait", "pace", "--output", "mine/pace"])
    several = ["transfer", "--robot", own_robot, "--gait", "trot", "pace", "--output", "mine"]
    assert "mine/pace" in refused(several)
    assert not Path("mine/trot").exists()


def test_formulas_go_where_the_expert_cannot(tmp_path, monkeypatch, own_robot, capsys):
    monkeypatch.chdir(tmp_path)
    path = Path(own_robot)
    path.write_text(path.read_text().replace("action_scale: 0.25 ", "action_scale: 0.3 "))
    main(["transfer", "--robot", own_robot, "--gait", "trot", "--output", "mine"])
    assert "left out" in "".join(capsys.readouterr())
    assert Path("mine/sparse_formula.formulas").exists()
    assert not Path("mine/trot.safetensors").exists()


def test_writes_nothing_where_one_gait_has_no_policies(tmp_path, monkeypatch, refused):
    monkeypatch.chdir(tmp_path)
    several = ["--gait", "trot", "half_bound", "--output", "mine"]
    message = refused(["transfer", "--robot", "a1", "--of", "go2", *several])
    assert "holds no policies of the half_bound" in message and "for this gait alone" in message
    assert not Path("mine").exists()


def test_says_that_a_run_is_of_another_gait(tmp_path, monkeypatch, refused):
    monkeypatch.chdir(tmp_path)
    expert = load_expert("trot")
    expert.save(Path("run/expert.safetensors"))
    load_student("trot", "sparse_formula").save(Path("run/sparse_formula.formulas"))
    Path("run/config.yaml").write_text(yaml.safe_dump({"inputs": {"expert": expert.digest()}}))
    message = refused(["transfer", "--robot", "go2", "--gait", "walk", "--source", "run"])
    assert "is an expert for gait 'trot', not 'walk'" in message
