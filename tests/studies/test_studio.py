"""The studio: edits of a formula, the robot that acts by them, and the command."""

import socket
import sys

import numpy as np
import pytest

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.scenario import Scenario
from glassgait.models.errors import InputError
from glassgait.models.policies.library import load_policy
from glassgait.models.robots import quadruped
from glassgait.models.task.gait import load_gait
from glassgait.models.task.observation import machine_state_entries
from glassgait.studies.common.policies import find_policies
from glassgait.studies.studio.live_robot import FALLEN_STEPS, LiveRobot
from glassgait.studies.studio.session import EditSession

FL_THIGH = (0, 1)


@pytest.fixture(scope="module")
def found():
    return find_policies(load_gait("trot"), quiet=True)


@pytest.fixture
def session(found):
    return EditSession(found.formulas("formulas"), found.expert)


@pytest.fixture(scope="module")
def built(found):
    command = FixedCommand(0.0, 0.0, 8)
    return LiveRobot(found.gait, Scenario(command=command), found.controller("formulas"))


@pytest.fixture
def robot(built, found):
    """The robot, not in its thread, standing and unedited."""
    built.act_by(found.formulas("formulas"))
    built.restart()
    built.pause(False)
    built.falls = [0, 0]
    built.answer()
    return built


def walk(robot, n_steps):
    """Advances robot and ghost, and returns their last samples."""
    for _ in range(n_steps):
        robot.answer()
        robot.advance()
    return robot.samples()[-1]


def with_constant(session, value, place=FL_THIGH):
    """Returns the text of a formula with another first number."""
    first, rest = session.text(place).split(" ", maxsplit=1)
    assert float(first)
    return f"{value} {rest}"


@pytest.fixture
def observations(session):
    names = session.policy.observation_names
    drawn = np.random.default_rng(3).normal(scale=0.1, size=(20, len(names)))
    drawn[:, machine_state_entries(names)] = [1.0, 0.0]
    return drawn


def test_an_edited_constant_changes_the_target_by_its_difference(session, observations):
    before, number = session.policy(observations)[:, 1], float(session.text(FL_THIGH).split()[0])
    session.replace(FL_THIGH, with_constant(session, f"{number + 0.1:.3g}"))
    change = session.policy.robot.action_scale * (session.policy(observations)[:, 1] - before)
    np.testing.assert_allclose(change, 0.1, atol=1e-12)


def test_the_text_of_a_formula_is_the_formula(session, observations):
    before = session.policy(observations)
    for place in session.places:
        session.replace(place, session.text(place))
    np.testing.assert_array_equal(session.policy(observations), before)
    assert session.diff() == []


def test_undo_and_redo_restore_the_text_of_the_file(session):
    original = session.policy.to_text()
    session.replace(FL_THIGH, with_constant(session, "0.6"))
    edited = session.policy.to_text()
    assert [line[0] for line in session.diff() if not line.startswith("@")] == ["-", "+"]
    session.undo()
    session.undo()
    assert (session.policy.to_text(), session.diff()) == (original, [])
    session.redo()
    assert session.policy.to_text() == edited
    session.reset()
    assert session.policy.to_text() == original


@pytest.mark.parametrize(
    "text", ["", "0.1*", "0.1*q.FL_wing", "__import__('os')", "1e999", "x0", "q.FL_thigh.real"]
)
def test_text_that_is_no_formula_is_refused_and_changes_nothing(text, session):
    before = session.policy
    with pytest.raises(InputError):
        session.replace(FL_THIGH, text)
    assert session.policy is before


def test_the_saved_file_is_the_policy_that_walks(session, observations, tmp_path):
    session.replace(FL_THIGH, with_constant(session, "0.6"))
    path = session.save(tmp_path, "mine")
    saved = load_policy(path)
    np.testing.assert_array_equal(saved(observations), session.policy(observations))
    assert session.save(tmp_path, "mine") == path
    other = EditSession(session.policy, session.policy)
    assert other.save(tmp_path, "mine").name == "mine_2.formulas"


def test_robot_and_ghost_part_at_an_edit(robot, session):
    robot.steer(FixedCommand(0.3, 0.0, 8))
    edited, ghost = walk(robot, 30)
    np.testing.assert_array_equal(edited.state, ghost.state)
    session.replace(FL_THIGH, with_constant(session, "0.75"))
    robot.act_by(session.policy)
    walk(robot, 50)
    thigh = (quadruped.JOINT_POSITION.start or 0) + 1
    angles = np.array([[own.state[thigh] for own in pair] for pair in robot.samples()[-25:]])
    assert abs(angles[:, 0].mean() - angles[:, 1].mean()) > 0.02


def test_a_push_to_the_left_moves_both_to_the_left(robot):
    walk(robot, 10)
    robot.push(np.array([0.0, 0.5, 0.0]))
    for pushed in walk(robot, 10):
        assert pushed.state[quadruped.POSITION][1] > 0.03


def test_both_stand_again_a_second_after_a_fall(robot, session):
    original = session.policy
    session.replace(FL_THIGH, "3")
    robot.act_by(session.policy)
    while robot.falls[0] == 0 and not robot.problem:
        walk(robot, 1)
    robot.act_by(original)
    edited, _ = walk(robot, FALLEN_STEPS + 1)
    assert not edited.fallen
    assert edited.state[quadruped.POSITION][2] > 0.2


def test_an_action_that_is_not_finite_stops_time(robot, session):
    session.replace(FL_THIGH, "1/(cmd.yaw*0)")
    robot.act_by(session.policy)
    walk(robot, 3)
    assert robot.paused
    assert "finite" in robot.problem


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--policy", "expert"], "not made of formulas"),
        (["--policy", "gbm"], "not made of formulas"),
        (["--port", "{taken}"], "is taken"),
        (["--port", "70000"], "port"),
    ],
)
def test_the_command_refuses_what_cannot_be_done(arguments, message, refused, tmp_path):
    pytest.importorskip("nicegui")
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        port = listening.getsockname()[1]
        given = [own.format(taken=port) for own in arguments]
        assert message in refused(["studio", *given, "--output", str(tmp_path / "run")])


def test_the_command_says_how_to_install_nicegui(refused, monkeypatch):
    monkeypatch.delitem(sys.modules, "glassgait.studies.studio.page", raising=False)
    monkeypatch.setitem(sys.modules, "nicegui", None)
    assert "pip install 'glassgait[studio]'" in refused(["studio"])
