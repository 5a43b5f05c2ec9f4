"""Who acts when."""

import numpy as np
import pytest

from glassgait.models.errors import InputError
from glassgait.models.policies.controller import (
    Controller,
    alone,
    estimator_in_loop,
)
from glassgait.models.policies.library import load_expert, load_student
from glassgait.models.robots.robot import JointLaw
from glassgait.models.task.alternation import expert_acts, ratio_title

PAGES = ("trot", "bound", "walk")


@pytest.mark.parametrize(
    ("period", "acts"),
    [(1, [1, 1, 1, 1, 1, 1]), (2, [1, 0, 1, 0, 1, 0]), (4, [1, 0, 0, 0, 1, 0]), (0, [0] * 6)],
)
def test_expert_acts_every_nth_step(period, acts):
    np.testing.assert_array_equal(expert_acts(np.arange(6), period), np.array(acts, dtype=bool))


def test_ratios_are_named_as_in_the_paper():
    assert [ratio_title(period) for period in (1, 2, 8, 0)] == ["1", "1/2", "1/8", "0"]


@pytest.mark.parametrize("period", [1, 2, 4, 0])
def test_an_alternating_policy_acts_as_expert_acts_says(trot, make_policy, period):
    expert, student = make_policy(trot, seed=1), make_policy(trot, seed=2)
    controller = Controller(expert, student, period)
    observation, memory = np.ones((3, len(expert.observation_names))), controller.begin(3)
    for step in range(9):
        output = controller.advance(step, observation, memory)
        assert output.expert_acts.tolist() == 3 * [bool(expert_acts(step, period))]
        acting = expert if expert_acts(step, period) else student
        np.testing.assert_array_equal(output.action, acting(observation))


@pytest.mark.parametrize(
    ("period", "message"), [(2, "needs a student"), (0, "needs a"), (-1, "is -1")]
)
def test_an_alternation_without_its_student_is_refused(trot, make_policy, period, message):
    with pytest.raises(ValueError, match=message):
        Controller(make_policy(trot), None, period)


def test_the_experts_estimator_observes_for_both(trot, make_policy):
    expert = load_expert("trot")
    assert alone(make_policy(trot), expert).estimator is expert.estimator
    assert alone(make_policy(trot)).estimator is None


@pytest.mark.parametrize(
    ("expert_limits", "student_limits", "period", "limited"),
    [
        (False, True, 0, True),
        (False, True, 1, False),
        (False, True, 3, False),
        (False, False, 0, False),
        (True, False, 0, True),
        (True, False, 1, True),
        (True, False, 3, True),
    ],
)
def test_targets_are_limited_by_the_expert_or_by_a_student_that_acts_alone(
    trot, make_policy, expert_limits, student_limits, period, limited
):
    expert, student = make_policy(trot, seed=1), make_policy(trot, seed=2)
    expert.joint_law = JointLaw(limited=expert_limits)
    student.joint_law = JointLaw(limited=student_limits)
    assert Controller(expert, student, period).joint_law.limited is limited
    assert alone(expert).joint_law.limited is expert_limits


def test_joints_have_the_gains_of_the_policy_that_acts_or_else_of_its_expert(trot, make_policy):
    expert, student = make_policy(trot, seed=1), make_policy(trot, seed=2)
    firm = expert.with_joint_law(JointLaw((40.0, 1.0)))
    assert alone(student, firm).joint_law.gains == (40.0, 1.0)
    soft = student.with_joint_law(JointLaw((10.0, 1.0)))
    assert alone(soft, firm).joint_law.gains == (10.0, 1.0)
    assert Controller(firm, student, 3).joint_law.gains == (40.0, 1.0)
    with pytest.raises(InputError, match="gains"):
        Controller(firm, soft, 3)


@pytest.mark.parametrize("gait", PAGES)
def test_shipped_pages_are_limited_and_have_gains_as_their_experts(gait):
    for policy in (load_student(gait, "sparse_formula"), load_expert(gait)):
        assert policy.joint_law == JointLaw((40.0, 1.0)).with_limits(policy.robot)


def test_expert_and_student_that_both_act_have_the_same_limits(trot, make_policy):
    expert, student = make_policy(trot, seed=1), make_policy(trot, seed=2)
    law = JointLaw().with_limits(expert.robot)
    limited = student.with_joint_law(law)
    with pytest.raises(InputError, match="limits"):
        Controller(expert, limited, period=2)
    assert Controller(expert, limited, period=0).joint_law == law
    both = Controller(expert.with_joint_law(law), student, period=2)
    assert both.joint_law == law


def test_a_loop_takes_the_policys_estimator_or_the_truth_if_asked(trot, make_policy):
    expert, page = load_expert("trot"), load_student("trot", "sparse_formula")
    for policy in (expert, page, alone(expert), alone(page)):
        assert estimator_in_loop(policy) is policy.estimator is not None
        assert estimator_in_loop(policy, true_body_state=True) is None
    bare = make_policy(trot)
    for policy in (bare, Controller(bare, bare, period=2)):
        assert estimator_in_loop(policy, true_body_state=True) is None
        with pytest.raises(InputError, match="true_b"):
            estimator_in_loop(policy)


def test_a_student_does_not_act_beside_another_expert_than_its_own(trot, small_expert):
    trees, expert = load_student("trot", "gbm"), load_expert("trot")
    other = small_expert(trot, imu=True, odometry=expert.estimator)
    assert alone(trees, expert).student is trees
    message = f"the expert {expert.digest()}, not by that of {other.digest()}"
    with pytest.raises(InputError, match=message):
        alone(trees, other)


def test_a_policy_does_not_observe_by_an_expert_of_another_gait():
    with pytest.raises(InputError, match=r"trot.*bound"):
        load_student("bound", "sparse_formula").with_estimator_of(load_expert("trot"))
