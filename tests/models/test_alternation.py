"""Alternation: which policy acts at each control step."""

import numpy as np
import pytest

from glassgait.models.errors import InputError
from glassgait.models.policies.controller import Controller, alone, estimator_in_loop
from glassgait.models.policies.library import load_expert, load_student
from glassgait.models.robots.robot import JointLaw, TargetLimits
from glassgait.models.task.alternation import expert_acts, ratio_title


def test_ratios_are_named_as_in_the_paper():
    assert [ratio_title(period) for period in (1, 2, 8, 0)] == ["1", "1/2", "1/8", "0"]


@pytest.mark.parametrize(
    ("period", "acts"),
    [(1, [1, 1, 1, 1, 1, 1]), (2, [1, 0, 1, 0, 1, 0]), (4, [1, 0, 0, 0, 1, 0]), (0, [0] * 6)],
)
def test_the_expert_acts_every_nth_step(trot, make_policy, period, acts):
    assert [expert_acts(step, period) for step in range(6)] == acts
    expert, student = make_policy(trot, seed=1), make_policy(trot, seed=2)
    controller = Controller(expert, student, period)
    observation = np.ones((3, len(expert.observation_names)))
    for step, expert_is_next in enumerate(acts):
        output = controller.advance(step, observation)
        assert output.expert_acts.tolist() == 3 * [bool(expert_is_next)]
        acting = expert if expert_is_next else student
        np.testing.assert_array_equal(output.action, acting(observation))


@pytest.mark.parametrize(
    ("period", "message"), [(2, "needs a student"), (0, "needs a"), (-1, "is -1"), (0.25, "0.25")]
)
def test_an_alternation_without_sense_is_refused(trot, make_policy, period, message):
    with pytest.raises(InputError, match=message):
        Controller(make_policy(trot), None, period)


FIRM, SOFT, LIMITED = JointLaw((40.0, 1.0)), JointLaw((10.0, 1.0)), JointLaw(limited=True)


@pytest.mark.parametrize(
    ("experts", "students", "period", "law"),
    [
        (JointLaw(), LIMITED, 0, LIMITED),
        (JointLaw(), LIMITED, 1, JointLaw()),
        (JointLaw(), LIMITED, 3, JointLaw()),
        (LIMITED, JointLaw(), 0, LIMITED),
        (LIMITED, JointLaw(), 3, LIMITED),
        (FIRM, JointLaw(), 0, FIRM),
        (FIRM, SOFT, 0, SOFT),
        (FIRM, JointLaw(), 3, FIRM),
        (FIRM, SOFT, 3, "gains"),
        (JointLaw(), JointLaw(limits=TargetLimits(40.0)), 2, "limits"),
    ],
)
def test_joints_follow_the_law_of_the_expert_or_of_a_student_that_acts_without_it(
    trot, make_policy, experts, students, period, law
):
    expert = make_policy(trot, seed=1).with_joint_law(experts)
    student = make_policy(trot, seed=2).with_joint_law(students)
    if isinstance(law, str):
        with pytest.raises(InputError, match=law):
            Controller(expert, student, period)
    else:
        assert Controller(expert, student, period).joint_law == law


def test_a_loop_takes_the_policys_estimator_or_the_truth_if_asked(trot, make_policy):
    expert, page = load_expert("trot"), load_student("trot", "formulas")
    for policy in (expert, page, alone(expert), alone(page)):
        assert estimator_in_loop(policy) is policy.estimator is not None
        assert estimator_in_loop(policy, true_body_state=True) is None
    bare = make_policy(trot)
    for policy in (bare, Controller(bare, bare, period=2)):
        assert estimator_in_loop(policy, true_body_state=True) is None
        with pytest.raises(InputError, match="true_b"):
            estimator_in_loop(policy)


def test_other_students_than_the_experts_are_refused(trot, small_expert):
    trees, expert = load_student("trot", "gbm"), load_expert("trot")
    other = small_expert(trot, imu=True, odometry=expert.estimator)
    assert alone(trees, expert).student is trees
    message = f"the estimator of the expert {expert.digest()}, not of {other.digest()}"
    with pytest.raises(InputError, match=message):
        alone(trees, other)
    with pytest.raises(InputError, match="trot cannot act with an expert of the pace"):
        alone(trees, load_expert("pace"))
