"""Runtime assurance: overruns, hysteresis, and the policy that both make."""

from dataclasses import replace

import numpy as np
import pytest

from glassgait.models.errors import InputError
from glassgait.models.policies.controller import AlternatingController, AssuredController
from glassgait.models.robots.joint_law import JointLaw
from glassgait.models.task.assurance import (
    EnsembleDisagreement,
    Hysteresis,
    MonitorState,
    Region,
    initial_monitor,
    step_monitor,
)
from glassgait.models.task.gait import load_gait
from glassgait.models.task.observation import ObservationLayout

NAMES = ObservationLayout(2).names
STATES = [NAMES.index("RM State 0"), NAMES.index("RM State 1")]
HIP = NAMES.index("DoF Pos FL Hip")


def region_of_two():
    """The hip is within ±1 in state 0 and exactly 3 in state 1; all else is within ±10."""
    lower, upper = np.full((2, 49), -10.0), np.full((2, 49), 10.0)
    lower[:, HIP], upper[:, HIP] = (-1.0, 3.0), (1.0, 3.0)
    return Region(NAMES, lower, upper)


def observing(hip, state=0):
    observation = np.zeros(49)
    observation[HIP] = hip
    observation[STATES[state]] = 1.0
    return observation


def test_overruns_are_in_widths_of_the_box_of_the_machines_state():
    observation = np.array([[observing(1.0), observing(-1.5)], [observing(3.0, 1), observing(2.0)]])
    region = region_of_two()
    np.testing.assert_allclose(region.overrun(observation), [[0.0, 0.25], [0.0, 0.5]])
    assert region.overruns(observation).shape == (2, 2, 49)
    assert region.overruns(observation)[0, 1].argmax() == HIP
    assert region.overrun(observing(2.9, 1)) == np.inf
    assert region.overrun(observing(np.nan)) == np.inf


def disagreeing(usual=((0.1, 0.0), (0.5, 0.0))):
    """The region of two, and the student's models disagree by as much as the hip differs from 0."""
    return replace(
        region_of_two(),
        disagreement=EnsembleDisagreement(lambda seen: abs(seen[..., HIP]), np.array(usual)),
    )


def test_disagreement_counts_in_widths_of_what_is_usual_in_the_machines_state():
    region, observation = disagreeing(), np.array([[observing(0.4)], [observing(0.9)]])
    overruns = region.overruns(observation)
    assert overruns.shape == (2, 1, 50)
    np.testing.assert_allclose(overruns[..., -1], [[0.0], [1.0]])
    np.testing.assert_array_equal(overruns[..., :-1], region_of_two().overruns(observation))
    np.testing.assert_allclose(region.overrun(observation), [[0.0], [1.0]])
    # In a state where the bags always agreed any disagreement is too much.
    assert region.overrun(observing(3.0, 1)) == np.inf
    assert disagreeing(((0.1, 0.0), (0.5, 3.0))).overrun(observing(3.0, 1)) == 0.0


@pytest.mark.parametrize(
    "usual",
    [
        ((0.5,),) * 2,
        ((0.5, 0.5), (0.5, np.inf)),
        ((0.5, 0.5), (0.5, np.nan)),
        ((0.5, 0.5), (0.5, 0.4)),
    ],
)
def test_disagreement_that_cannot_be_is_refused(usual):
    with pytest.raises(InputError, match="2 states"):
        disagreeing(usual)


def decisions(overruns, hysteresis):
    memory, acts = initial_monitor((1,)), ""
    for overrun in overruns:
        memory = step_monitor(memory, np.array([overrun]), hysteresis)
        acts += "E" if memory.expert_acts[0] else "S"
    return acts


@pytest.mark.parametrize(
    ("overruns", "acts"),
    [
        ([0.0, 0.2, 0.21, 0.0, 0.0, 0.0, 0.0], "SSEEESS"),
        ([0.3, 0.0, 0.0, 0.15, 0.0, 0.0, 0.0], "EEEEEES"),
        ([0.15, 0.15, np.nan, 0.1, 0.1, 0.1], "SSEEES"),
    ],
)
def test_the_expert_is_called_at_once_and_let_go_when_calm_for_a_while(overruns, acts):
    assert decisions(overruns, Hysteresis(0.2, 0.1, return_steps=3)) == acts


def test_robots_are_guarded_each_for_itself():
    generator = np.random.default_rng(4)
    overruns = generator.exponential(0.1, size=(60, 5))
    hysteresis = Hysteresis(0.2, 0.1, return_steps=4)
    memory, together = initial_monitor((5,)), []
    for overrun in overruns:
        memory = step_monitor(memory, overrun, hysteresis)
        together.append(memory.expert_acts)
    for robot in range(5):
        alone = decisions(overruns[:, robot], hysteresis)
        assert alone == "".join("E" if acts else "S" for acts in np.array(together)[:, robot])


def test_limits_that_cannot_be_are_refused():
    with pytest.raises(InputError, match="return_limit"):
        Hysteresis(0.2, 0.3)
    with pytest.raises(InputError, match="return_steps"):
        Hysteresis(0.2, 0.1, return_steps=0)


def test_regions_that_cannot_be_are_refused():
    corner = np.zeros((2, 49))
    with pytest.raises(InputError, match="49 observations"):
        Region(NAMES, corner[:1], corner[:1])
    upper = corner.copy()
    upper[1, HIP] = -1.0
    with pytest.raises(InputError, match="DoF Pos FL Hip"):
        Region(NAMES, corner, upper)


@pytest.fixture
def assured(trot, make_policy):
    hysteresis = Hysteresis(0.2, 0.1, return_steps=2)
    return AssuredController(
        make_policy(trot, 1), make_policy(trot, 2), region_of_two(), hysteresis
    )


def test_each_robot_is_moved_by_the_policy_that_its_observations_call(assured):
    first = np.array([observing(0.0), observing(5.0), observing(0.5)])
    output = assured.advance(0, first, assured.begin(3))
    assert output.expert_acts.tolist() == [False, True, False]
    expected = assured.student(first)
    expected[1] = assured.expert(first[1])
    np.testing.assert_allclose(output.action, expected, atol=1e-12)
    calm = np.array([observing(0.0)] * 3)
    output = assured.advance(1, calm, output.memory)
    assert output.expert_acts.tolist() == [False, True, False]
    assert not assured.advance(2, calm, output.memory).expert_acts.any()
    # A robot that starts anew gets what `begin` returns; the others go on.
    reset = MonitorState(*(np.where([False, True, False], 0, part) for part in output.memory))
    assert not assured.advance(2, calm, reset).expert_acts.any()


def test_the_same_guards_give_the_same_turn(assured):
    observation, memory = np.array([observing(5.0), observing(0.0)]), assured.begin(2)
    first, again = (assured.advance(0, observation, memory) for _ in range(2))
    np.testing.assert_array_equal(first.action, again.action)
    assert not memory.expert_acts.any() and not memory.calm_steps.any()


def test_settings_distinguish_regions_and_limits(assured):
    region = region_of_two()
    other = Region(NAMES, region.lower - 1.0, region.upper)
    message = [
        AssuredController(assured.expert, assured.student, own, Hysteresis(limit, 0.1)).settings()
        for own, limit in [(region, 0.2), (other, 0.2), (region, 0.3), (region, 0.2)]
    ]
    assert message[0] == message[3]
    assert message[0] != message[1] != message[2] != message[0]
    disagreements = [
        AssuredController(assured.expert, assured.student, disagreeing(usual), Hysteresis(0.2, 0.1))
        for usual in (((0.1, 0.0), (0.5, 0.0)), ((0.1, 0.0), (0.6, 0.0)))
    ]
    assert message[0] != disagreements[0].settings() != disagreements[1].settings()


def test_a_student_that_disagrees_gives_way_where_nothing_is_out_of_range(assured):
    policy = replace(assured, region=disagreeing())
    calm = np.array([observing(0.4), observing(0.9)])
    assert assured.advance(0, calm, assured.begin(2)).expert_acts.tolist() == [False, False]
    assert policy.advance(0, calm, policy.begin(2)).expert_acts.tolist() == [False, True]


def test_a_region_of_another_gait_is_refused(assured, make_policy):
    walk = make_policy(load_gait("walk"))
    with pytest.raises(InputError, match="observations"):
        AssuredController(walk, walk, assured.region, assured.hysteresis)


def test_a_student_whose_joints_have_other_gains_is_refused(assured):
    firm = assured.student.with_joint_law(JointLaw((60.0, 1.0)))
    with pytest.raises(InputError, match="gains"):
        replace(assured, student=firm)


def test_a_schedule_chooses_the_acting_policy(trot, make_policy):
    policy = AlternatingController(make_policy(trot, 1), make_policy(trot, 2), period=2)
    observation, memory = np.array([observing(0.0)] * 2), policy.begin(2)
    outputs = [policy.advance(step, observation, memory) for step in range(2)]
    assert [output.expert_acts.tolist() for output in outputs] == [[True, True], [False, False]]
    np.testing.assert_array_equal(outputs[1].action, policy.student(observation))
