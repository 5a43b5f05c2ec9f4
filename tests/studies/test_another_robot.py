"""A robot other than the default one goes from training to a certificate that is checked."""

import json
from pathlib import Path

import pytest

from glassgait.models.certificates.certificate import certificate_text, content_digest
from glassgait.models.errors import InputError
from glassgait.models.policies.library import load_expert, load_policy
from glassgait.models.robots.library import load_robot
from glassgait.models.task.gait import load_gait
from glassgait.studies.cli import main

TINY = ["--settings", str(Path(__file__).parent / "settings" / "train.yaml"), "--n-robots", "32"]


def forge(certificate: dict) -> None:
    """Writes changed contents of a certificate, with a digest of these contents."""
    signed = {**certificate, "sha256": content_digest(certificate)}
    Path("proved/certificate.json").write_text(certificate_text(signed))


@pytest.mark.slow
def test_another_robot_goes_from_training_to_a_certificate(tmp_path, monkeypatch, write_robot):
    monkeypatch.chdir(tmp_path)
    robot = str(write_robot(like="go2"))
    own = ["--robot", robot, "--policy", "formulas"]
    main(["train", "--robot", robot, "--updates", "3", *TINY])
    expert_file = tmp_path / "runs" / "train" / "dog" / "trot" / "trot.safetensors"
    expert = load_expert("trot", expert_file, load_robot(robot))
    assert expert.robot is load_robot(robot)
    few = ["--episodes", "5", "--episodes-per-round", "5", "--alone-rounds", "0"]
    few += ["--episode-steps", "100"]
    main(["distill", "--robot", robot, "--students", "formulas", *few])
    folder = tmp_path / "runs" / "distill" / "dog" / "trot"
    path = folder / "formulas.formulas"
    assert "robot: dog\n" in path.read_text()
    assert load_policy(path, expert.robot).robot is expert.robot
    main(["view", *own, "--n-steps", "10", "--output", "seen"])
    main(["explain", "page", *own, "--n-steps", "10", "--output", "explained"])
    main(["evaluate", "scenarios", *own, "--n-robots", "2", "--n-steps", "20", "--n-seeds", "1"])
    main(["export", *own, "--n-steps", "200", "--output", "exported"])
    (source,) = (tmp_path / "exported").glob("*.c")
    assert "Unitree Go2" in source.read_text()
    assert list((tmp_path / "seen").glob("*.html"))
    # Nothing is written where the default robot's runs are.
    kept = [path for path in (tmp_path / "runs").rglob("trot*") if path.is_dir()]
    assert {path.parent.name for path in kept} == {"dog"}
    main(["verify", "prove", *own, "--measure", "--n-steps", "20", "--output", "proved"])
    certificate = json.loads((tmp_path / "proved" / "certificate.json").read_text())
    assert certificate["robot"] == "dog"
    proved = [claim for claim in certificate["claims"] if claim["outcome"] == "proved"]
    assert len(proved) > 5
    checked = ["verify", "check", "proved", "--policy", str(path)]
    checked += ["--robot", robot]
    main(checked)
    forge(certificate | {"numbers": certificate["numbers"] | {"torque": 1e3}})
    with pytest.raises(SystemExit, match="2"):
        main(checked)
    forge({key: value for key, value in certificate.items() if key != "robot"})
    with pytest.raises(SystemExit, match="2"):
        main(checked)
    # No other robot acts by it.
    with pytest.raises(InputError, match="'robot'"):
        load_expert(load_gait("trot"), expert_file, load_robot())
