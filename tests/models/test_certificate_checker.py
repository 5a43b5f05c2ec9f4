"""The checker accepts shipped certificates, and rejects changed certificates and policies."""

import json
from copy import deepcopy
from pathlib import Path

import pytest
import yaml

from glassgait.models.certificates import checker
from glassgait.models.certificates.certificate import (
    OUTCOME_WORDS,
    SHIPPED,
    certificate_text,
    check_certificate,
    content_digest,
    shipped_certificates,
)
from glassgait.models.certificates.checker.policy import JOINTS
from glassgait.models.errors import InputError
from glassgait.models.files import digest
from glassgait.models.policies.library import STUDENT_DIRECTORY, shipped_experts
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot, robot_folder, robot_names

POLICY = STUDENT_DIRECTORY / "bound" / "formulas.formulas"
A1 = load_robot()
PATH = next(path for path in shipped_certificates() if path.name == "bound_formulas.json")
CONTENT = json.loads(PATH.read_text())


def written(content: dict, folder: Path) -> Path:
    """Writes a certificate with a digest of its contents."""
    path = folder / "certificate.json"
    path.write_text(certificate_text({**content, "sha256": content_digest(content)}))
    return path


# Certificates of a few claims are checked in test_certificate_forgery.py.
@pytest.mark.slow
@pytest.mark.parametrize("path", shipped_certificates(), ids=lambda path: path.stem)
def test_shipped_certificates_hold(path):
    claims, report = json.loads(path.read_text())["claims"], check_certificate(path)
    first, *lines = report.split("\n")
    assert first.endswith("the one that ships")
    for outcome, word in OUTCOME_WORDS.items():
        assert f"{sum(claim['outcome'] == outcome for claim in claims)} {word}" in first
    # The report has one line per claim, with its number.
    assert len(lines) == len(claims)
    for line, claim in zip(lines, claims, strict=True):
        assert claim["name"] in line and "not a claim that ships" not in line
        assert ("(most " in line) == (claim["kind"] != "mirror")


def test_every_policy_of_formulas_that_ships_has_a_certificate_of_less_than_a_megabyte():
    certified = {}
    for path in shipped_certificates():
        policy = json.loads(path.read_text())["policy"]
        certified[path.relative_to(SHIPPED).with_suffix("")] = policy["sha256"]
        assert path.stat().st_size < 1_000_000, path.name
    for robot in robot_names():
        for gait in shipped_experts(robot):
            folder = robot_folder(STUDENT_DIRECTORY, robot) / gait
            files = {path.stem: path for path in folder.glob("*.formulas")}
            for name, file in files.items():
                where = robot_folder(Path(), robot) / f"{gait}_{name}"
                assert certified.pop(where) == digest(file)
    assert not certified


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"kind": "effect"', '"kind": "never"', "needs the key"),
        ("0.0", "0.00001", "was changed"),
        ('"format": 3', '"format": true', "format"),
        ('"claims": [', '"claim": [', "'claim'"),
        ("{", "[", "is no certificate"),
    ],
)
def test_refuses_a_certificate_that_was_changed(tmp_path, old, new, message):
    path = tmp_path / "certificate.json"
    path.write_text(PATH.read_text().replace(old, new, 1))
    with pytest.raises(InputError, match=message):
        check_certificate(path)


def test_refuses_another_policy(tmp_path):
    path = tmp_path / "formulas.formulas"
    path.write_text(POLICY.read_text().replace("= 0.1", "= 0.2", 1))
    with pytest.raises(InputError, match="certified"):
        check_certificate(PATH, path)
    other = {"policy": {**CONTENT["policy"], "file": "symbolic_per_state.formulas"}}
    with pytest.raises(InputError, match="certified"):
        check_certificate(written(CONTENT | other, tmp_path))


def test_refuses_a_policy_that_robots_refuse(tmp_path):
    path, content = tmp_path / "formulas.formulas", deepcopy(CONTENT)
    path.write_text(POLICY.read_text().replace("gains: [40, 1]", "gains: [41, 1]"))
    content["policy"]["sha256"] = digest(path)
    with pytest.raises(InputError, match="torque is divided by 40"):
        check_certificate(written(content, tmp_path), path)


def test_never_runs_what_a_policy_file_holds(tmp_path):
    path, content = tmp_path / "formulas.formulas", deepcopy(CONTENT)
    path.write_text(POLICY.read_text().replace("\nFL_hip = ", "\nFL_hip = exit(0) + ", 1))
    content["policy"]["sha256"] = digest(path)
    found = written(content, tmp_path)
    with pytest.raises(InputError, match="exit"):
        check_certificate(found, path)
    with pytest.raises(checker.RefusedError, match="does not belong"):
        checker.check(found, path)


@pytest.mark.parametrize("name", ["go2", "spot", "../a1", "a1/../a1", None, ["a1"], {}])
def test_refuses_the_name_of_another_robot(tmp_path, name):
    for policy in (POLICY, None):
        with pytest.raises(InputError, match=r"robot|no policy"):
            check_certificate(written({**CONTENT, "robot": name}, tmp_path), policy)


@pytest.mark.parametrize(("key", "urdf"), [("stiffness", ""), ("action_scale", ""), ("", "40")])
def test_refuses_a_file_of_the_robot_that_is_not_the_one_that_ships(tmp_path, key, urdf):
    path, text = tmp_path / "robot.yaml", A1.urdf_path.read_text()
    said = yaml.safe_load(Path(A1.path).read_text())
    path.write_text(yaml.safe_dump(said | ({key: 5.0} if key else {})))
    (tmp_path / "a1.urdf").write_text(text.replace('effort="33.5"', f'effort="{urdf or 33.5}"', 1))
    with pytest.raises(InputError, match="a robot that ships; give it another name"):
        check_certificate(PATH, robot=path)


def test_imports_nothing_of_the_project_but_itself():
    assert tuple(JOINTS) == quadruped.JOINTS
    for path in Path(checker.__file__).parent.glob("*.py"):
        text = path.read_text()
        assert "from glassgait" not in text
        assert "import glassgait" not in text
        assert "from .." not in text
