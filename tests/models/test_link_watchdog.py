"""What a robot does while its controller answers in time, late, or not at all."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glassgait.models.errors import InputError
from glassgait.models.link.watchdog import (
    BRACED,
    BRACING,
    CROUCH,
    FOLDED,
    FOLDING,
    Answer,
    Phase,
    Watchdog,
    initial_watch,
    lowering_targets,
    step_watch,
)
from glassgait.models.robots import kinematics
from glassgait.models.robots.library import load_robot
from glassgait.models.task import CONTROL_PERIOD

A1 = load_robot()


FARTHEST = A1.effort[0] / A1.stiffness
SETTINGS = Watchdog(hold=0.1, lowering=1.0, recovery=0.4, rising=0.8, lean=30.0)
STEP = 0.01
HERE = A1.default_stance + 0.1
"""Where joints are."""


def targets(time):
    return A1.default_stance + 0.01 * time


class Watched:
    """Steps a watch every 10 ms; answers are those of a time, or none."""

    def __init__(self):
        self.watch, self.now, self.answer, self.lean = initial_watch(A1), 0.0, None, 0.0

    def run(self, seconds, *, answered=True, late=0.0):
        """Goes on; each answer is to the sensors of the control instant before, `late` ago."""
        phases = []
        for _ in range(round(seconds / STEP)):
            instant = CONTROL_PERIOD * ((self.now - late + 1e-9) // CONTROL_PERIOD)
            if answered and instant >= 0.0:
                self.answer = Answer(1, instant, targets(instant))
            self.watch = step_watch(
                A1,
                self.watch,
                self.answer,
                self.now,
                SETTINGS,
                position=HERE,
                lean=self.lean,
            )
            phases.append(Phase(self.watch.phase))
            self.now += STEP
        return phases


def test_stands_until_a_controller_answers():
    one = Watched()
    assert set(one.run(5.0, answered=False)) == {Phase.STANDING}
    np.testing.assert_array_equal(one.watch.targets, A1.default_stance)
    assert not one.watch.followed


def test_follows_answers_that_come_in_time():
    one = Watched()
    assert set(one.run(1.0)) == {Phase.FOLLOWING}
    np.testing.assert_allclose(one.watch.targets, targets(0.98))
    assert one.watch.followed


def test_holds_the_last_targets_and_takes_newer_ones_at_once():
    one = Watched()
    one.run(1.0)
    # The latest answer is to the sensors of 0.98 s.
    assert one.run(0.08, answered=False) == [Phase.FOLLOWING] + 7 * [Phase.HOLDING]
    np.testing.assert_allclose(one.watch.targets, targets(0.98))
    assert one.watch.followed
    assert set(one.run(0.1)) == {Phase.FOLLOWING}


def test_late_targets_are_better_than_older_ones():
    one = Watched()
    one.run(1.0)
    assert Phase.HOLDING in one.run(0.5, late=0.04)
    np.testing.assert_allclose(one.watch.targets, targets(1.44), atol=1e-9)


def test_is_lowered_to_a_crouch_once_targets_are_too_old():
    one = Watched()
    one.run(1.0)
    phases = one.run(0.2, answered=False)
    # The latest answer, to the sensors of 0.98 s, is 0.11 s old then.
    assert phases.index(Phase.LOWERED) == 9
    assert set(phases[9:]) == {Phase.LOWERED}
    before = one.watch.targets
    one.run(3.0, answered=False)
    assert not one.watch.followed
    assert np.any(before != one.watch.targets)
    np.testing.assert_allclose(one.watch.targets, CROUCH)


def test_rises_when_answers_have_come_in_time_for_long_enough_and_then_follows():
    one = Watched()
    one.run(1.0)
    one.run(3.0, answered=False)
    begun = one.now
    phases = one.run(3.0)
    rises, follows = phases.index(Phase.STANDING), phases.index(Phase.FOLLOWING)
    assert rises * STEP == pytest.approx(SETTINGS.recovery, abs=2 * STEP)
    assert (follows - rises) * STEP == pytest.approx(SETTINGS.rising, abs=2 * STEP)
    assert one.watch.answered > begun


def test_stays_lowered_while_answers_come_now_and_then():
    one = Watched()
    one.run(1.0)
    one.run(2.0, answered=False)
    for _ in range(10):
        assert set(one.run(0.3)) == {Phase.LOWERED}
        assert set(one.run(0.1, answered=False)) == {Phase.LOWERED}


def test_a_robot_that_rises_without_a_controller_stands():
    one = Watched()
    one.run(1.0)
    one.run(3.0, answered=False)
    one.run(0.6)
    assert set(one.run(3.0, answered=False)) == {Phase.STANDING}
    np.testing.assert_allclose(one.watch.targets, A1.default_stance)


def test_a_robot_that_leans_too_far_stays_down_until_it_is_level():
    one = Watched()
    one.run(1.0)
    one.run(3.0, answered=False)
    one.lean = 31.0
    phases = one.run(3.0)
    assert phases.index(Phase.TIPPED) * STEP == pytest.approx(SETTINGS.recovery, abs=2 * STEP)
    assert phases[-1] is Phase.TIPPED
    np.testing.assert_array_equal(one.watch.targets, CROUCH)
    assert not one.watch.followed
    # Setting it upright is no reason to rise unless a controller answers.
    one.run(0.1, answered=False)
    one.lean = 29.0
    assert set(one.run(0.3)) == {Phase.TIPPED}
    assert one.run(2.0)[-1] is Phase.FOLLOWING


def test_a_robot_that_tips_over_while_it_rises_or_waits_is_lowered():
    one = Watched()
    one.run(1.0, answered=False)
    one.lean = 90.0
    assert set(one.run(1.0)) == {Phase.LOWERED}
    assert one.run(2.0)[-1] is Phase.TIPPED


@pytest.mark.parametrize("lean", [np.nan, np.inf])
def test_a_robot_whose_lean_is_not_known_does_not_rise(lean):
    one = Watched()
    one.run(1.0)
    one.run(3.0, answered=False)
    one.lean = lean
    assert one.run(3.0)[-1] is Phase.TIPPED


JOINTS = st.lists(st.floats(-2.7, 4.2), min_size=12, max_size=12).map(np.array)


@given(JOINTS)
def test_all_legs_are_alike_once_they_are_folded(begin):
    for time, expected in (
        (0.0, begin),
        (FOLDING, FOLDED),
        (FOLDING + BRACING, BRACED),
        (FOLDING + BRACING + SETTINGS.lowering, CROUCH),
        (100.0, CROUCH),
    ):
        np.testing.assert_allclose(lowering_targets(begin, time, SETTINGS), expected, atol=1e-9)
    for time in np.arange(FOLDING, 2.0, 0.01):
        legs = lowering_targets(begin, time, SETTINGS).reshape(4, 3)
        legs[1::2, 0] *= -1.0
        np.testing.assert_allclose(legs, np.tile(legs[0], (4, 1)), atol=1e-9)


@pytest.mark.parametrize(
    "answer",
    [
        Answer(1, 0.5, targets(7.0)),
        Answer(1, 1.5, targets(7.0)),
        Answer(1, 1.0, np.full(12, np.nan)),
        Answer(1, np.nan, targets(7.0)),
        Answer(1, 1.0, np.full(12, 1e308)),
        Answer(1, 1.0, A1.lower_limits - FARTHEST * np.eye(12)[5] - 1e-6),
    ],
    ids=["old", "of the future", "not finite", "of no time", "far beyond", "too far of one joint"],
)
def test_an_answer_that_is_none_changes_nothing(answer):
    one = Watched()
    one.run(1.0)
    watch = step_watch(A1, one.watch, answer, 1.0, SETTINGS, position=HERE)
    np.testing.assert_array_equal(watch.targets, one.watch.targets)
    assert watch.answered == one.watch.answered


def test_targets_a_little_beyond_a_joints_range_are_followed_to_its_end():
    one = Watched()
    one.run(1.0)
    asked = np.where(np.arange(12) % 2, A1.upper_limits + 0.999 * FARTHEST, A1.lower_limits - 0.1)
    watch = step_watch(A1, one.watch, Answer(1, 1.0, asked), 1.0, SETTINGS, position=HERE)
    ends = np.where(np.arange(12) % 2, A1.upper_limits, A1.lower_limits)
    np.testing.assert_array_equal(watch.targets, ends)


@given(st.lists(st.sampled_from([None, 0.0, 0.01, 0.02, 0.03, 0.2, -1.0, np.nan]), max_size=200))
def test_targets_never_jump_but_to_what_a_controller_answers(ages):
    watch, now = initial_watch(A1), 0.0
    for age in ages:
        answer = None if age is None else Answer(1, now - age, np.full(12, 0.3))
        after = step_watch(A1, watch, answer, now, SETTINGS, position=HERE)
        assert np.all(np.isfinite(after.targets))
        if not after.followed:
            # Smooth steps are fastest in their middle: 1.5 times as fast as straight ones.
            seconds = FOLDING if after.phase == Phase.LOWERED else SETTINGS.rising
            greatest = np.abs(FOLDED - A1.default_stance).max() + 3.0
            moved = np.abs(after.targets - watch.targets).max()
            assert moved <= 1.5 * STEP / seconds * greatest
        watch, now = after, now + STEP


@pytest.mark.parametrize("pose", [FOLDED, BRACED, CROUCH], ids=["folded", "braced", "crouch"])
def test_poses_are_within_the_joints_ranges_and_keep_the_trunk_off_the_ground(pose):
    assert np.all((pose > A1.lower_limits) & (pose < A1.upper_limits))
    state = kinematics.standing_state(A1, pose)
    assert kinematics.clearances(A1, state).body[0] > 0.03
    # Every foot stands outside its hip, and level with it to 1 mm.
    points = kinematics.leg_points(A1, pose)
    outward = (points.foot - points.thigh)[:, 1] * [1, -1, 1, -1]
    assert np.all(outward > 0.02)
    np.testing.assert_allclose(points.foot[:, 0], points.thigh[:, 0], atol=1e-3)


def test_settings_are_checked():
    with pytest.raises(InputError, match="hold"):
        Watchdog(hold=0.0)


class Damping(Watched):
    """Answers that ask for no stiffness."""

    damped = True

    def run(self, seconds, *, answered=True, late=0.0):
        if not answered:
            return super().run(seconds, answered=False)
        phases = []
        for _ in range(round(seconds / STEP)):
            instant = CONTROL_PERIOD * ((self.now + 1e-9) // CONTROL_PERIOD)
            self.answer = Answer(1, instant, targets(instant), self.damped)
            phases += super().run(STEP, answered=False)
        return phases


def test_joints_brake_at_once_where_the_controller_asks_for_it():
    one = Damping()
    assert set(one.run(0.5)) == {Phase.DAMPED}
    np.testing.assert_array_equal(one.watch.targets, HERE)
    assert one.watch.followed
    one.damped = False
    assert one.run(0.1)[-1] is Phase.FOLLOWING
    np.testing.assert_allclose(one.watch.targets, targets(one.now - STEP), atol=1e-3)
    one.damped = True
    assert one.run(0.1)[-1] is Phase.DAMPED


def test_a_damped_robot_whose_controller_vanishes_stays_damped():
    one = Damping()
    one.run(0.5)
    phases = one.run(30.0, answered=False)
    assert phases[0] is Phase.DAMPED and phases[-1] is Phase.LEFT
    np.testing.assert_array_equal(one.watch.targets, HERE)
    assert not one.watch.followed
    assert one.run(0.1)[-1] is Phase.DAMPED


def test_a_lying_robot_rises_for_a_controller_that_does_not_damp_it():
    one = Watched()
    one.watch = initial_watch(A1, lies=True)
    assert set(one.run(1.0, answered=False)) == {Phase.LEFT}
    phases = one.run(SETTINGS.recovery + SETTINGS.rising + 0.1)
    assert phases[0] is Phase.LEFT
    assert Phase.STANDING in phases
    assert phases[-1] is Phase.FOLLOWING


def test_a_lying_robot_that_leans_stays_damped():
    one = Watched()
    one.watch, one.lean = initial_watch(A1, lies=True), SETTINGS.lean + 1.0
    assert set(one.run(3.0)) == {Phase.LEFT}


def test_a_robot_that_is_being_lowered_is_not_damped_before_it_lies():
    one = Damping()
    one.damped = False
    one.run(1.0)
    one.run(0.3, answered=False)
    assert one.watch.phase == Phase.LOWERED
    one.damped = True
    assert one.run(0.3)[-1] is Phase.LOWERED
    assert one.run(SETTINGS.lowering + 0.2)[-1] is Phase.DAMPED


@pytest.mark.parametrize("late", [0.03, 0.3])
def test_an_answer_that_says_damped_and_is_late_damps(late):
    one = Watched()
    one.run(1.0)
    one.now += late
    answer = Answer(1, one.now - late, targets(0.0), True)
    phases = []
    for _ in range(200):
        one.watch = step_watch(A1, one.watch, answer, one.now, SETTINGS, position=HERE)
        phases.append(Phase(one.watch.phase))
        np.testing.assert_array_equal(one.watch.targets, HERE)
        one.now += STEP
    assert set(phases) <= {Phase.DAMPED, Phase.LEFT} and phases[-1] is Phase.LEFT
