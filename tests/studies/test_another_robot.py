"""A robot other than the default one goes from training to a certificate that is checked."""

import json
from pathlib import Path

import pytest

from glassgait.models.certificates.certificate import certificate_text, content_digest
from glassgait.models.errors import InputError
from glassgait.models.policies.library import load_expert, load_policy
from glassgait.models.robots.robot import load_robot
from glassgait.models.task.gait import load_gait
from glassgait.studies.cli import main

TINY = ["--n-robots", "32", "--n-groups", "2", "--fine-steps", "0.005"]


def forge(certificate: dict) -> None:
    """Writes changed contents of a certificate, with a digest of these contents."""
    signed = {**certificate, "sha256": content_digest(certificate)}
    Path("proved/certificate.json").write_text(certificate_text(signed))


@pytest.mark.slow
def test_go2_is_trained_distilled_watched_explained_exported_and_certified(tmp_path, monkeypatch):
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
    main(["verify", "prove", *own, "--measure", "--n-steps", "20", "--output", "proved"])
    certificate = json.loads((tmp_path / "proved" / "certificate.json").read_text())
    low, high = certificate["boxes"]["physical"]["q.RL_thigh"]
    assert certificate["robot"] == "go2"
    assert low <= -0.5236 and high >= 4.5379  # rad, the range of the rear thighs alone
    assert len(certificate["statements"]) > 2 * 2 * 2 * 12
    checked = ["verify", "check", "proved", "--policy", "students/sparse_formula.formulas"]
    main(checked)
    lowered = certificate["statements"][0]
    lowered["bound"] = lowered["reached"] - 1e-6
    forge(certificate)
    with pytest.raises(SystemExit, match="2"):
        main(checked)
    forge({key: value for key, value in certificate.items() if key != "robot"})
    with pytest.raises(SystemExit, match="2"):
        main(checked)
    # No other robot acts by it.
    with pytest.raises(InputError, match="'robot'"):
        load_expert(load_gait("trot"), tmp_path / "expert" / "trot.safetensors", load_robot())
