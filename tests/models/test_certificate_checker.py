"""The checker: shipped certificates hold, and changed ones, or changed policies, do not."""

import json
import shutil
from copy import deepcopy
from pathlib import Path

import pytest
import yaml

from glassgait.models.certificates import checker
from glassgait.models.certificates.certificate import (
    OUTCOME_WORDS,
    SHIPPED,
    certificate_text,
    content_digest,
    shipped_certificates,
)
from glassgait.models.certificates.checker import RefusedError, check
from glassgait.models.certificates.checker import robot as restated
from glassgait.models.files import digest
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.policies.library import STUDENT_DIRECTORY, shipped_experts
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot, robot_folder, robot_names
from glassgait.models.task.observation import ObservationLayout
from glassgait.models.task.termination import TerminationLimits

POLICY = STUDENT_DIRECTORY / "bound" / "formulas.formulas"
A1 = load_robot()
PATH = next(path for path in shipped_certificates() if path.name == "bound_formulas.json")
CONTENT = json.loads(PATH.read_text())


def written(content: dict, folder: Path, *, signed: bool = True) -> Path:
    """Writes a certificate, with a digest of its own contents or the old one."""
    path = folder / "certificate.json"
    own = {**content, "sha256": content_digest(content)} if signed else content
    path.write_text(certificate_text(own))
    return path


# Certificates of a few claims are checked where forgeries are made from them.
@pytest.mark.slow
@pytest.mark.parametrize("path", shipped_certificates(), ids=lambda path: path.stem)
def test_shipped_certificates_hold(path):
    content = json.loads(path.read_text())
    message = check(path)
    assert message.startswith(f"{len(content['statements'])} bounds hold")
    assert message.endswith("the one that ships")
    for outcome, word in OUTCOME_WORDS.items():
        count = sum(claim["outcome"] == outcome for claim in content["claims"])
        assert f"{count} {word}" in message


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
    ("old", "new"), [('"state": 0', '"state": 1'), ('"bound": ', '"bound": 1'), ("0.0", "0.00001")]
)
def test_refuses_a_certificate_that_was_changed(tmp_path, old, new):
    path = tmp_path / "certificate.json"
    path.write_text(PATH.read_text().replace(old, new, 1))
    with pytest.raises(RefusedError, match="the certificate was changed"):
        check(path)


def test_refuses_another_policy(tmp_path):
    path = tmp_path / "formulas.formulas"
    path.write_text(POLICY.read_text().replace("= 0.1", "= 0.2", 1))
    with pytest.raises(RefusedError, match="certified"):
        check(PATH, path)
    other = {"policy": {**CONTENT["policy"], "file": "symbolic_per_state.formulas"}}
    with pytest.raises(RefusedError, match="certified"):
        check(written(CONTENT | other, tmp_path))


@pytest.mark.parametrize(
    ("text", "message"),
    [("", "cannot be read"), ("[]", "no certificate"), ("{}", "no certificate")],
)
def test_refuses_what_is_no_certificate(tmp_path, text, message):
    path = tmp_path / "certificate.json"
    path.write_text(text)
    with pytest.raises(RefusedError, match=message):
        check(path)


def test_never_runs_what_a_policy_file_holds(tmp_path):
    text = POLICY.read_text().replace("\nFL_hip = ", "\nFL_hip = exit(0) + ", 1)
    path = tmp_path / "formulas.formulas"
    path.write_text(text)
    content = deepcopy(CONTENT)
    content["policy"]["sha256"] = digest(path)
    with pytest.raises(RefusedError, match="does not belong"):
        check(written(content, tmp_path), path)


@pytest.mark.parametrize("name", robot_names())
def test_reads_the_robot_as_it_is(name):
    robot, path = load_robot(name), Path(load_robot(name).path)
    read = restated.Robot.read(path)
    assert tuple(restated.JOINTS) == quadruped.JOINTS == tuple(read.limits)
    assert [*read.stance.values()] == robot.default_stance.tolist()
    assert list(map(list, zip(*read.limits.values(), strict=True))) == [
        robot.lower_limits.tolist(),
        robot.upper_limits.tolist(),
    ]
    assert [*read.effort.values()] == robot.effort.tolist()
    assert (read.stiffness, read.action_scale) == (robot.stiffness, robot.action_scale)
    assert TerminationLimits().action_change == restated.ABRUPT
    for imu in (False, True):
        layout, symbols = ObservationLayout(4, imu=imu), restated.symbols(4, imu)
        assert symbols == [entry.symbol for entry in layout.entries]
        units = RobotUnits.of(robot, layout.names)
        assert [read.offset(name) for name in symbols] == units.offset.tolist()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("go2", "another robot"),
        ("spot", "no robot 'spot' ships"),
        ("../a1", "no name of a robot"),
        ("a1/../a1", "no name of a robot"),
        (None, "no name of a robot"),
        (["a1"], "no name of a robot"),
        ({}, "no name of a robot"),
    ],
)
def test_refuses_the_name_of_another_robot(tmp_path, name, message):
    with pytest.raises(RefusedError, match=message):
        check(written({**CONTENT, "robot": name}, tmp_path), POLICY)


ROBOT = yaml.safe_load(Path(A1.path).read_text())


@pytest.mark.parametrize(
    ("robot", "urdf"), [({"stiffness": 20.0}, ""), ({"name": "b1"}, ""), ({}, "40")]
)
def test_refuses_a_file_of_the_robot_that_is_not_the_one_that_ships(tmp_path, robot, urdf):
    path, text = tmp_path / "robot.yaml", A1.urdf_path.read_text()
    path.write_text(yaml.safe_dump(ROBOT | robot))
    (tmp_path / "a1.urdf").write_text(text.replace('effort="33.5"', f'effort="{urdf or 33.5}"', 1))
    with pytest.raises(RefusedError, match="is not the a1 that ships"):
        check(PATH, robot=path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gravity": 9.81}, "other keys"),
        ({"name": "../a1"}, "'name'"),
        ({"name": "other"}, "another robot"),
        ({"stiffness": "20"}, "'stiffness'"),
        ({"action_scale": 0.0}, "'action_scale'"),
        ({"stance": {"FL": [0.1, 0.8, -1.5]}}, "'stance'"),
        ({"stance": ROBOT["stance"] | {"FL": [0.1, True, -1.5]}}, "'stance'"),
        ({"mass": 12.0}, "other keys"),
        ({"description": "none.urdf"}, "none.urdf"),
    ],
)
def test_refuses_what_is_no_robots_file(tmp_path, changes, message):
    path = tmp_path / "robot.yaml"
    shutil.copy(A1.urdf_path, tmp_path)
    path.write_text(yaml.safe_dump(ROBOT | {"name": "mine"} | changes))
    with pytest.raises(RefusedError, match=message):
        check(written({**CONTENT, "robot": "mine"}, tmp_path), POLICY, robot=path)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('upper="0.8029"', 'upper="-1"'),
        ('effort="33.5"', 'effort="inf"'),
        ('name="FL_hip" type', 'name="FL" type'),
        ("</robot>", ""),
    ],
)
def test_refuses_a_urdf_without_sound_limits(tmp_path, old, new):
    path = tmp_path / "robot.yaml"
    path.write_text(yaml.safe_dump(ROBOT | {"name": "mine"}))
    (tmp_path / "a1.urdf").write_text(A1.urdf_path.read_text().replace(old, new, 1))
    with pytest.raises(RefusedError, match=r"a1\.urdf"):
        check(written({**CONTENT, "robot": "mine"}, tmp_path), POLICY, robot=path)


def test_refuses_a_robots_file_that_says_a_key_twice_or_unfolds(tmp_path):
    path, text = tmp_path / "robot.yaml", yaml.safe_dump(ROBOT | {"name": "mine"})
    content = written({**CONTENT, "robot": "mine"}, tmp_path)
    for more, message in (("stiffness: 1.0\n", "twice"), ("x: &x 1\ny: *x\n", "aliases")):
        path.write_text(text + more)
        with pytest.raises(RefusedError, match=message):
            check(content, POLICY, robot=path)


def test_imports_nothing_of_the_project_but_itself():
    for path in Path(checker.__file__).parent.glob("*.py"):
        text = path.read_text()
        assert "from glassgait" not in text
        assert "import glassgait" not in text
