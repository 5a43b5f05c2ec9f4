"""Regions and limits of runtime assurance, chosen from what robots observe in distribution."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from glassgait.models.policies.library import load_student
from glassgait.models.robots.library import load_robot
from glassgait.models.task.assurance import Hysteresis
from glassgait.models.task.gait import load_gait
from glassgait.studies.evaluation.assurance_calibration import (
    Calibration,
    Visits,
    choose_hysteresis,
    guarded,
    has_ensemble,
    joined,
    make_region,
    make_regions,
)

A1 = load_robot()


PAGE = load_student("trot", "sparse_formula")
NAMES = PAGE.observation_names
N = len(NAMES)
STATES = [NAMES.index("RM State 0"), NAMES.index("RM State 1")]
HIP, COMMAND = NAMES.index("DoF Pos FL Hip"), NAMES.index("Command X")


def seen(hip, state):
    """Makes visits of robots that stayed up from what their hips were (T, n)."""
    observation = np.zeros((*hip.shape, N))
    observation[..., HIP] = hip
    for index, entry in enumerate(STATES):
        observation[..., entry] = state == index
    return Visits(observation, np.full(hip.shape[1], len(hip)))


def test_a_region_bounds_each_state_but_leaves_commands_their_range(trot, generator):
    hip = generator.uniform(0.0, 1.0, (4000, 2))
    state = np.arange(4000)[:, None] % 2 + np.zeros((1, 2))
    region = make_region(trot, PAGE, seen(hip + 5.0 * state, state), quantile=0.01)
    np.testing.assert_allclose(region.lower[:, HIP], [0.01, 5.01], atol=0.01)
    np.testing.assert_allclose(region.upper[:, HIP], [0.99, 5.99], atol=0.01)
    assert (region.lower[0, COMMAND], region.upper[0, COMMAND]) == (-1.0, 1.0)
    whole = make_region(trot, PAGE, seen(hip + 5.0 * state, state), quantile=0.01, kind="whole")
    assert whole.lower[0, HIP] == whole.lower[1, HIP] < 0.1
    assert whole.upper[0, HIP] == whole.upper[1, HIP] > 5.9


def test_what_fell_robots_saw_bounds_nothing(trot):
    hip = np.array([[0.0, 0.0], [1.0, 9.0], [1.0, 9.0]])
    visits = replace(seen(hip, np.zeros((3, 2))), fell=np.array([3, 0]))
    assert make_region(trot, PAGE, visits, quantile=0.0).upper[0, HIP] == 1.0


def test_robots_of_several_walks_stand_side_by_side(trot):
    first, second = (
        seen(np.ones((4, 2)), np.zeros((4, 2))),
        seen(np.full((4, 1), 3.0), np.ones((4, 1))),
    )
    both = joined([first, replace(second, fell=np.array([2]))])
    assert both.observation.shape == (4, 3, N)
    assert both.fallen.tolist() == [2]
    region = make_region(trot, PAGE, both, quantile=0.0)
    assert region.upper[:, HIP].tolist() == [1.0, 3.0]


def test_in_a_state_that_no_robot_was_in_everything_is_outside(trot):
    region = make_region(trot, PAGE, seen(np.ones((5, 1)), np.zeros((5, 1))), quantile=0.0)
    observation = np.zeros(N)
    observation[[HIP, STATES[1]]] = 1.1, 1.0
    assert region.overrun(observation) == np.inf


@pytest.fixture
def bagged():
    """The additive student that ships, whose models disagree."""
    return load_student("trot", "ebm")


@pytest.fixture
def wandering(generator):
    """Visits of robots that observe anything."""
    visits = seen(np.zeros((200, 3)), np.arange(200)[:, None] % 2 + np.zeros((1, 3)))
    visits.observation[..., : min(STATES)] = generator.normal(size=(200, 3, min(STATES)))
    return visits


def test_regions_of_ensembles_ask_for_their_usual_disagreement(bagged, trot, wandering):
    regions = make_regions(trot, bagged, wandering, quantile=0.1)
    assert list(regions) == [
        "states",
        "whole",
        "operating",
        "disagreement",
        "states_and_disagreement",
    ]
    assert [kind for kind, own in regions.items() if own.disagreement] == [
        "disagreement",
        "states_and_disagreement",
    ]
    for state in range(2):
        own = wandering.observation[state::2].reshape(-1, N)
        outside = regions["disagreement"].overrun(own)
        assert 0.0 < (outside > 0.0).mean() < 0.1 + 1e-9
        both = regions["states_and_disagreement"].overrun(own)
        np.testing.assert_array_equal(both, np.maximum(outside, regions["states"].overrun(own)))


@pytest.mark.parametrize("kind", ["sparse_formula", "gbm", "statewise_linear"])
def test_other_students_have_no_ensemble(kind, trot):
    visits = seen(np.ones((4, 2)), np.arange(4)[:, None] % 2 + np.zeros((1, 2)))
    student = load_student("trot", kind)
    assert not has_ensemble(student)
    assert list(make_regions(trot, student, visits, 0.0)) == ["states", "whole", "operating"]


def test_a_calibration_comes_back_with_its_disagreement(bagged, trot, wandering):
    limits = {0.02: Hysteresis(0.1, 0.05, 3)}
    for kind, region in make_regions(trot, bagged, wandering, quantile=0.1).items():
        made = Calibration(region, limits, *[pd.DataFrame({"kind": [kind]})] * 3)
        back = Calibration.from_plain(json.loads(json.dumps(made.to_plain())), bagged)
        observed = 2.0 * wandering.observation
        expected = region.overruns(observed)
        np.testing.assert_array_equal(back.region.overruns(observed), expected)
        assert back.hysteresis == limits
        assert back.warnings.equals(made.warnings)


def test_the_limit_is_the_least_that_calls_the_expert_in_a_share_of_steps(generator):
    overrun = generator.exponential(0.05, (500, 8))
    alive = np.ones((500, 8), dtype=bool)
    for calls in (0.02, 0.2):
        found = choose_hysteresis(overrun, alive, calls, return_steps=5)
        assert guarded(overrun, found).mean() <= calls
        smaller = replace(found, limit=0.98 * found.limit, return_limit=0.49 * found.limit)
        assert guarded(overrun, smaller).mean() > 0.95 * calls
        assert found.return_limit == found.limit / 2
    assert choose_hysteresis(np.zeros((5, 2)), alive[:5, :2], 0.05, 5).limit == 0.0


def test_the_walk_has_a_box_for_each_of_its_states():
    student = load_student("walk", "sparse_formula")
    names = student.observation_names
    observation = np.zeros((8, 1, len(names)))
    first = names.index("RM State 0")
    for step in range(8):
        observation[step, 0, first + step % 4] = 1.0
    observation[..., names.index("Command RM Iters")] = 0.8
    visits = Visits(observation, np.array([8]))
    region = make_region(load_gait("walk"), student, visits, quantile=0.0)
    assert region.lower.shape == (4, len(names))
    np.testing.assert_array_equal(region.overrun(observation), np.zeros((8, 1)))
