"""A gait of a user and a robot of others go the whole road, from another folder."""

import shutil
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import pytest
import yaml

from glassgait.models.policies.library import load_policy
from glassgait.models.robots.robot import ROBOT_DIRECTORY
from glassgait.studies.cli import main

HOP = """
description: All four feet leave the ground together.
max_speed: 0.5
max_yaw_rate: 0.5
dwell: [6, 11]
clearance: 0.03
states: [down, up]
initial: down
transitions:
  - {from: down, to: up, when: ~FL & ~FR & ~RL & ~RR}
  - {from: up, to: down, when: FL & FR & RL & RR}
"""

TRAIN = ["--settings", str(Path(__file__).parent / "settings" / "train.yaml"), "--updates", "1"]
SMALL = ["--n-robots", "2", "--n-steps", "40", "--n-seeds", "1"]
ROAD = {
    "gait": ["gaits/hop.yaml"],
    "train": TRAIN,
    "distill": [
        *["--episodes", "5", "--alone-rounds", "1", "--episode-steps", "40", "--n-workers", "1"],
        *["--source", "runs/train/hop", "--students", "linear_per_state", "symbolic_per_state"],
    ],
    "evaluate scenarios": [*SMALL, "--scenario", "nominal"],
    "view": ["--policy", "linear_per_state", "--n-steps", "20"],
    "explain page": ["--policy", "linear_per_state", "--n-steps", "20", "--step", "1"],
    "importance": [*["--n-samples", "20", "--repeats", "1"], *["--policy", "linear_per_state"]],
}


LAIKAGO = "cmeel.prefix/share/example-robot-data/robots/laikago_description/urdf/laikago.urdf"


@pytest.mark.slow
def test_a_gait_of_a_user_goes_the_whole_road(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "gaits").mkdir()
    (tmp_path / "gaits" / "hop.yaml").write_text(HOP)
    for command, arguments in ROAD.items():
        gait = [] if command == "gait" else ["--gait", "gaits/hop.yaml"]
        main([*command.split(), *gait, *arguments])
    runs = tmp_path / "runs"
    student = load_policy(runs / "distill" / "hop" / "linear_per_state.safetensors")
    assert student.gait == "hop"
    assert yaml.safe_load((runs / "train" / "hop" / "hop.yaml").read_text())["gait"] == "hop"
    for command in ROAD:
        if command != "gait":
            study = runs / command.replace("--", "").replace(" ", "/")
            assert [own.name.split("_")[0] for own in study.glob("hop*")] == ["hop"]
    assert list(runs.rglob("index.html"))


@pytest.mark.slow
def test_a_robot_of_others_goes_the_whole_road(tmp_path, monkeypatch, capsys):
    try:
        package = distribution("example-robot-data")
    except PackageNotFoundError:
        pytest.skip("needs the package example-robot-data (the dev extra)")
    # The page shows its robot.yaml, and the URDF is as its vendor wrote it.
    monkeypatch.chdir(tmp_path)
    page = (ROBOT_DIRECTORY / "README.md").read_text()
    Path("robot.yaml").write_text(page.partition("```yaml\n")[2].partition("```")[0])
    shutil.copy(package.locate_file(LAIKAGO), "laikago.urdf")
    main(["robot", "robot.yaml"])
    assert "25.433 kg" in capsys.readouterr().out
    main(["train", "--robot", "robot.yaml", "--updates", "2", *TRAIN[:2]])
    assert "watch: glassgait view --gait trot --robot" in capsys.readouterr().out
