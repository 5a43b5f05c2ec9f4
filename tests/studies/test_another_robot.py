"""A robot other than the default one goes through train, distill, view, explain and export."""

import pytest

from glassgait.models.errors import InputError
from glassgait.models.policies.library import load_expert, load_policy
from glassgait.models.robots.robot import load_robot
from glassgait.models.task.gait import load_gait
from glassgait.studies.cli import main

TINY = ["--n-robots", "32", "--n-groups", "2", "--fine-steps", "0.005"]


@pytest.mark.slow
def test_go2_is_trained_distilled_watched_explained_and_exported(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    main(["train", "--robot", "go2", "--updates", "3", "--output", "expert", *TINY])
    expert = load_expert("trot", tmp_path / "expert" / "trot.safetensors")
    assert expert.robot is load_robot("go2")
    few = ["--episodes", "5", "--episodes-per-round", "5", "--alone-rounds", "0"]
    few += ["--episode-steps", "100", "--output", "students"]
    main(["distill", "--expert", "expert/trot.safetensors", "--students", "sparse_formula", *few])
    path = tmp_path / "students" / "sparse_formula.formulas"
    assert "robot: go2\n" in path.read_text()
    assert load_policy(path).robot is expert.robot
    own = ["--source", "students", "--policy", "sparse_formula"]
    main(["view", *own, "--seconds", "0.2", "--output", "seen"])
    main(["explain", "page", *own, "--seconds", "0.2", "--output", "explained"])
    main(["export", *own, "--n-steps", "200", "--output", "exported"])
    (source,) = (tmp_path / "exported").glob("*.c")
    assert "Unitree Go2" in source.read_text()
    assert list((tmp_path / "seen").glob("*.html"))
    # No other robot acts by it.
    with pytest.raises(InputError, match="'robot'"):
        load_expert(load_gait("trot"), tmp_path / "expert" / "trot.safetensors", load_robot())
