"""`glassgait robot`: a robot of a description, checked, compared and standing."""

import re
from pathlib import Path

import pytest

from glassgait.models.robots.description import WRITTEN
from glassgait.models.robots.library import load_robot
from glassgait.studies.cli import main

A1 = load_robot()


@pytest.fixture
def described(monkeypatch, tmp_path):
    """Goes to a folder with a description of another project's: other joints' names."""
    monkeypatch.chdir(tmp_path)
    text = A1.urdf_path.read_text().replace('name="a1"', 'name="Dog One"')
    (tmp_path / "dog.urdf").write_text(text.replace('_hip"', '_abad"'))
    return tmp_path / "dog.urdf"


def test_makes_a_robot_that_loads_and_stands(described, capsys):
    main(["robot", "dog.urdf"])
    shown = capsys.readouterr().out
    assert "robots/dog/robot.yaml" in shown
    assert re.search(r"drake .* 4 ", shown) and re.search(r"mujoco .* 4 ", shown)
    robot = load_robot(Path("robots/dog/robot.yaml"))
    assert (robot.name, robot.full_name) == ("dog", "Dog One")
    assert robot.mass == pytest.approx(A1.mass)


def test_never_writes_over_a_robot(described, refused):
    main(["robot", "dog.urdf", "--name", "rex", "--output", "mine"])
    assert "is there already" in refused(["robot", "dog.urdf", "--name", "rex", "--output", "mine"])


def test_names_what_the_description_lacks_and_goes_on_once_it_is_filled_in(described, refused):
    text = re.sub(r'velocity="[^"]*"', "", described.read_text())
    described.write_text(text)
    answer = refused(["robot", "dog.urdf"])
    assert "velocity_limits" in answer and "fill" in answer
    path = Path("robots/dog/robot.yaml")
    assert "velocity_limits" in refused(["robot", str(path)])
    filled = re.sub(
        r"velocity_limits: .*", "velocity_limits: {hip: 9, thigh: 9, calf: 9}", path.read_text()
    )
    path.write_text(filled)
    main(["robot", str(path)])
    assert load_robot(path).velocity[0] == 9.0


def test_writes_the_description_of_an_edited_file_anew_and_no_other(described, refused):
    main(["robot", "dog.urdf"])
    path = Path("robots/dog/robot.yaml")
    path.write_text(path.read_text().replace("thigh_length: 0.2 ", "thigh_length: 0.21 "))
    main(["robot", str(path)])
    assert load_robot(path.resolve()).thigh_length == 0.21
    described_by_others = path.with_name("dog.urdf")
    text = described_by_others.read_text()
    described_by_others.write_text(text.replace(WRITTEN, ""))
    path.write_text(path.read_text().replace("thigh_length: 0.21", "thigh_length: 0.22"))
    assert "'thigh_length'" in refused(["robot", str(path)])


def test_reports_what_differs_from_another(described, capsys):
    heavier = described.read_text().replace('<mass value="6"/>', '<mass value="7"/>')
    described.write_text(heavier)
    main(["robot", "a1", "--against", "dog.urdf"])
    shown = capsys.readouterr().out
    assert re.search(r"trunk, mass \(kg\) .* 6.000 .* 7.000 ", shown)
    assert "thigh, mass" not in shown
    main(["robot", "a1", "--against", "go2"])
    assert re.search(r"RL, thigh, least angle", capsys.readouterr().out)


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        (r"stiffness: .*", "stiffness: 4", "give more stiffness"),
        (r"R([LR]): \[[^\]]*\]", r"R\1: [0.1, 1.9, -1.0]", "leans"),
    ],
)
def test_a_robot_that_does_not_stand_is_refused(described, refused, old, new, why):
    main(["robot", "dog.urdf"])
    path = Path("robots/dog/robot.yaml")
    path.write_text(re.sub(old, new, path.read_text()))
    assert why in refused(["robot", str(path)])


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["go3"], "go3"),
        (["go2", "--name", "rex"], "--name"),
        (["dog.urdf", "--name", "go2"], "go2"),
        (["dog.urdf", "--name", "Rex the dog"], "name"),
        (["cat.urdf"], "cat.urdf"),
        (["1234.urdf"], "--name"),
        (["a1", "--against", "cat.urdf"], "cat.urdf"),
    ],
)
def test_bad_arguments_are_refused(described, refused, arguments, named):
    assert named in refused(["robot", *arguments])
    assert not Path("robots").exists()
