"""`glassgait robot`: files are checked, and the robot must stand in both physics."""

import re
import shutil

import pytest

from glassgait.models.robots.library import load_robot, robot_names
from glassgait.studies.cli import main

A1 = load_robot()


@pytest.fixture
def dog(tmp_path):
    """Copies the default robot's files under another name."""
    text = (A1.urdf_path.with_name("robot.yaml")).read_text()
    path = tmp_path / "robot.yaml"
    path.write_text(text.replace("name: a1", "name: dog", 1).replace("a1.urdf", "dog.urdf"))
    shutil.copy(A1.urdf_path, tmp_path / "dog.urdf")
    urdf = tmp_path / "dog.urdf"
    urdf.write_text(urdf.read_text().replace('name="a1"', 'name="dog"'))
    return path


@pytest.mark.parametrize("name", robot_names())
def test_robots_that_ship_stand_in_both_physics(name, capsys):
    main(["robot", name])
    shown = capsys.readouterr().out
    assert re.search(r"drake .* 4 ", shown) and re.search(r"mujoco .* 4 ", shown)


def test_a_robot_file_of_a_user_is_checked(dog, capsys):
    main(["robot", str(dog)])
    assert "Unitree A1" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        (r"stiffness: .*", "stiffness: 4", "give more stiffness"),
        (r"R([LR]): \[[^\]]*\]", r"R\1: [0.1, 1.9, -1.0]", "leans"),
        (r"stiffness: .*", "mass: 3.0", "'mass'"),
    ],
)
def test_a_robot_that_does_not_stand_or_contradicts_its_urdf_is_refused(
    dog, refused, old, new, why
):
    dog.write_text(re.sub(old, new, dog.read_text()))
    assert why in refused(["robot", str(dog)])


def test_an_unknown_robot_is_refused(refused):
    assert "go3" in refused(["robot", "go3"])
