"""A robot's day as data, and its machine: what files are refused, and what leads where."""

import hypothesis.extra.numpy as arrays
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glassgait.models.errors import InputError
from glassgait.models.robots.joint_law import JointLaw
from glassgait.models.robots.library import load_robot
from glassgait.models.task.day import DAY_DIRECTORY, REQUESTS, load_day
from glassgait.models.task.mode_machine import ModeMachine, ModeReadings, eased

A1, GO2 = load_robot(), load_robot("go2")
DAY = load_day()
TEXT = (DAY_DIRECTORY / "day.yaml").read_text()
LEVEL = np.array([0.0] * 8 + [-1.0])
NUMBERS = st.floats(width=64)


def loaded(folder, text):
    path = folder / "mine.yaml"
    path.write_text(text)
    return load_day(path)


def with_lean(degrees):
    imu = LEVEL.copy()
    imu[6:9] = [0.0, np.sin(np.radians(degrees)), -np.cos(np.radians(degrees))]
    return imu


class Robot:
    """One robot of a machine, at the stance unless told otherwise."""

    def __init__(self, day=DAY, limits=None):
        self.machine = ModeMachine(day, A1, limits)
        self.state, self.action = self.machine.initial(), np.zeros(12)

    def step(self, request, n_steps=1, *, velocity=(0.0, 0.0), imu=LEVEL, asked=0.5, q=None):
        for _ in range(n_steps):
            position = A1.default_stance if q is None else q
            served = self.machine.served(np.array(velocity), np.array(REQUESTS.index(request)))
            self.found = self.machine.step(
                self.state,
                ModeReadings(position, np.zeros(12), imu),
                requested=np.array(REQUESTS.index(request)),
                served=served,
                action=np.full(12, asked),
                before=self.action,
            )
            self.state, self.action = self.found.state, self.found.action
        return self.machine.day.names[int(self.state.mode)]


def standing():
    """A robot that has risen."""
    robot, stand = Robot(), DAY.names.index("stand")
    robot.state = robot.state._replace(mode=np.array(stand), steps=np.array(20))
    return robot


def test_the_day_that_ships_suits_both_robots():
    for robot in (A1, GO2):
        limits = JointLaw().with_limits(robot).limits
        ModeMachine(DAY, robot, limits)


def test_a_motion_begins_and_ends_at_rest():
    share = np.linspace(0.0, 1.0, 101)
    path = eased(share)
    assert (path[0], path[-1]) == (0.0, 1.0)
    assert (np.diff(path) > 0).all()
    assert max(path[1], 1 - path[-2]) < 1e-3


def test_a_robot_rises_stands_walks_halts_and_lies_down():
    robot = Robot()
    assert robot.step("sit", 20) == "rest"
    assert robot.found.damped
    assert robot.step("stand") == "fold"
    assert robot.step("stand", 50) == "fold"
    np.testing.assert_allclose(robot.action, robot.machine.goals[1])
    assert robot.step("stand") == "rise"
    assert robot.step("stand", 76) == "stand"
    assert robot.step("walk", 40) == "stand"
    np.testing.assert_allclose(robot.action, 0.0)
    assert not robot.found.acts
    assert robot.step("walk", velocity=(0.3, 0.0)) == "walk"
    assert robot.found.acts
    np.testing.assert_array_equal(robot.action, 0.5)
    assert robot.step("walk", 25) == "walk"
    assert robot.step("walk") == "stand"
    assert robot.step("sit", 17) == "sit"
    assert robot.step("sit", 76) == "rest"


def test_the_policy_is_given_no_command_unless_it_is_to_walk_and_go():
    served = ModeMachine(DAY, A1).served
    walk, stand = (np.array(REQUESTS.index(name)) for name in ("walk", "stand"))
    np.testing.assert_array_equal(served(np.array([0.4, 0.01]), walk), [0.4, 0.01])
    np.testing.assert_array_equal(served(np.array([0.04, -0.04]), walk), 0.0)
    np.testing.assert_array_equal(served(np.array([0.4, 0.2]), stand), 0.0)
    with pytest.raises(ValueError, match="from 0 to 2"):
        served(np.zeros(2), np.array(3))


@pytest.mark.parametrize("degrees", [44.0, 46.0])
def test_a_lean_is_remembered(degrees):
    robot = standing()
    wrong = degrees > DAY.lean
    assert robot.step("stand", imu=with_lean(degrees)) == ("damped" if wrong else "stand")
    assert robot.step("walk", 100) == ("damped" if wrong else "stand")
    assert robot.step("sit", 2, velocity=(0.0, 0.0)) == ("rest" if wrong else "sit")


@settings(max_examples=20)
@given(position=arrays.arrays(float, 12, elements=NUMBERS), asked=NUMBERS)
def test_whatever_is_read_and_asked_targets_are_finite_and_damped_joints_stay(position, asked):
    robot = standing()
    robot.step("walk", velocity=(0.3, 0.0))
    mode = robot.step("walk", 20, velocity=(0.3, 0.0), q=position, asked=asked)
    assert np.isfinite(robot.action).all()
    sound = robot.machine.sound(ModeReadings(position, np.zeros(12), LEVEL))
    assert mode == ("walk" if sound and np.isfinite(asked) else "damped")
    robot.step("walk", 1, imu=with_lean(80.0), q=A1.default_stance + 0.1)
    assert robot.found.damped
    np.testing.assert_allclose(A1.joint_targets(robot.action), A1.default_stance + 0.1)


def test_robots_of_a_batch_do_as_each_does_alone():
    machine = ModeMachine(DAY, A1)
    n = 5
    generator = np.random.default_rng(0)
    batch, single = machine.initial((n,)), [machine.initial() for _ in range(n)]
    before = np.zeros((n, 12))
    for _ in range(120):
        imu = np.tile(LEVEL, (n, 1))
        requested = generator.integers(3, size=n)
        velocity, action = generator.normal(size=(n, 2)), generator.normal(size=(n, 12))
        readings = ModeReadings(
            A1.default_stance + 0.1 * generator.normal(size=(n, 12)), np.zeros((n, 12)), imu
        )
        found = machine.step(
            batch,
            readings,
            requested=requested,
            served=machine.served(velocity, requested),
            action=action,
            before=before,
        )
        for i in range(n):
            own = machine.step(
                single[i],
                ModeReadings(*(part[i] for part in readings)),
                requested=requested[i],
                served=machine.served(velocity[i], requested[i]),
                action=action[i],
                before=before[i],
            )
            single[i] = own.state
            np.testing.assert_array_equal(own.action, found.action[i])
            assert own.state.mode == found.state.mode[i]
        batch, before = found.state, found.action


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("initial: rest", "initial: bed", "key 'initial' names unknown mode 'bed'"),
        ("next: {stand: halted}", "next: {stand: tired}", "unknown proposition 'tired'"),
        ("next: {stand: halted}", "next: {bed: halted}", "unknown mode 'bed'"),
        ("joints: policy", "joints: dance", "it is one of policy, damp, stance, folded"),
        (
            "seconds: 1.5",
            "seconds: -1",
            "modes.*seconds is -1; it must be greater than or equal to 0",
        ),
        ("sit: sit & done}", "sit: done}", "walk and sit can be led to together"),
        ("next: {stand: halted}", "next: {stand: halted & go}", None),
        ("fault: {damped:", "fault: {stand:", "whose joints are not damped"),
        ("level: 20.0", "level: 50.0", "give a smaller level"),
        ("lean: 45.0", "lean: 450.0", "lean is 450.0; it must be less than or equal to 90"),
        ("lean: 45.0", "lean: 45.0\nlien: 45.0", "unknown key 'lien'; write 'lean', or remove it"),
        ("stand: done, sit", "sit", "mode 'stand' cannot be reached from 'rest'"),
        ("leaning | blind}", "leaning & ~leaning}", "can never hold"),
        ("seconds: 0.3", "seconds: 0.0", "give 0.02 or more"),
        ("(stand | walk) & done", "(stand | walk)", "add '& done'"),
        ("description: A", "descriptions: A", "lacks the key 'description'"),
    ],
)
def test_files_that_are_no_day_are_refused_in_a_sentence(tmp_path, old, new, message):
    text = TEXT.replace(old, new)
    assert text != TEXT
    if message is None:
        assert loaded(tmp_path, text).digest() != DAY.digest()
        return
    with pytest.raises(InputError, match=message) as raised:
        loaded(tmp_path, text)
    assert str(raised.value).startswith(str(tmp_path / "mine.yaml"))
    assert str(raised.value).isprintable()


def test_postures_beyond_a_joints_range_are_refused(tmp_path):
    day = loaded(tmp_path, TEXT.replace("[0.4, 1.4, -2.65]", "[0.4, 1.4, -2.75]"))
    with pytest.raises(InputError, match=r"'postures\.folded' has FL_calf at -2.75 rad"):
        ModeMachine(day, A1)


def test_unknown_days_are_refused():
    with pytest.raises(InputError, match="unknown day 'night'; there is day"):
        load_day("night")
