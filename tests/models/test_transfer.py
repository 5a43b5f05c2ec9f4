"""Policies of one robot that act on another."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glassgait.models.errors import InputError
from glassgait.models.policies.library import (
    STUDENT_DIRECTORY,
    load_expert,
    load_policy,
    load_student,
    policy_path,
)
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import Robot
from glassgait.models.robots.target_limits import TargetLimits

A1, GO2 = load_robot(), load_robot("go2")

KINDS = ("symbolic", "statewise_symbolic", "sparse_formula")


def standing(stance: dict, **others) -> Robot:
    """Returns a Go2 of another name that stands otherwise."""
    return replace(GO2, name="other", stance={**GO2.stance, **stance}, **others)


LOWER = standing(
    {
        leg: (hip, 0.7 + 0.2 * (leg[0] == "R"), -1.4)
        for leg, hip in {"FL": 0.15, "FR": -0.15, "RL": 0.15, "RR": -0.15}.items()
    }
)
"""All legs shifted alike, hips in the mirror."""


@cache
def of_both(kind: str) -> tuple[FormulaPolicy, FormulaPolicy]:
    """Returns the A1's formulas, and the same for a robot that stands lower."""
    own = load_student("trot", kind)
    assert isinstance(own, FormulaPolicy)
    return own, own.for_robot(LOWER)


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_formulas_answer_from_the_other_stance_as_they_did_from_the_first(kind, seed):
    own, other = of_both(kind)
    seen = np.random.default_rng(seed).normal(size=(4, len(own.observation_names)))
    np.testing.assert_allclose(other(seen), own(seen), rtol=0, atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_files_of_the_other_robot_hold_as_much_and_read_back(kind, tmp_path):
    own, other = of_both(kind)
    assert other.robot is LOWER and other.to_file().robot == "other"
    # What is left out as a mirror image is left out there, too.
    assert len(other.to_file().written()) == len(own.to_file().written())
    assert len(other.to_file().written_definitions()) == len(own.to_file().written_definitions())
    path = tmp_path / "other.formulas"
    other.save(path)
    again = load_policy(path, LOWER)
    assert again.digest() == other.digest()
    assert again.machine == own.machine and again.estimator == own.estimator


def test_of_an_equal_stance_a_file_changes_by_the_robot_and_whose_lengths_it_has():
    file = policy_path(STUDENT_DIRECTORY / "trot", "sparse_formula")
    moved = load_policy(file).for_robot(GO2).to_text().splitlines()
    robot, *others = [line for line in moved if line not in file.read_text().splitlines()]
    assert robot == "robot: go2"
    assert others and all(line.endswith(", by the a1's lengths") for line in others)
    assert len(others) == sum("sin(q" in line or "cos(q" in line for line in moved)


@pytest.mark.parametrize("kind", KINDS)
def test_a_stance_that_is_not_its_own_image_is_served_joint_by_joint(kind):
    bent = standing({"FR": (-0.3, 0.6, -1.2)})
    own = load_student("trot", kind)
    other = own.for_robot(bent)
    assert other.to_file().mirror is None
    # Where no reading is at an end of its range.
    seen = 0.05 * np.random.default_rng(2).normal(size=(20, len(own.observation_names)))
    np.testing.assert_allclose(other(seen), own(seen), rtol=0, atol=1e-9)


def test_a_policy_that_comes_back_is_the_one_that_left():
    own = load_student("trot", "sparse_formula")
    back = own.for_robot(LOWER).for_robot(A1)
    assert back.to_text() == own.to_text()
    # On a third robot feet are still placed by the first one's lengths.
    assert own.for_robot(LOWER).for_robot(GO2).to_text() == own.for_robot(GO2).to_text()


def test_experts_keep_their_numbers():
    own = load_expert("trot")
    other = own.for_robot(GO2)
    seen = np.random.default_rng(1).normal(size=(4, len(own.observation_names)))
    np.testing.assert_array_equal(other(seen), own(seen))
    assert other.robot is GO2 and own.robot is A1
    assert other.digest() != own.digest()


def test_gains_are_to_the_other_robot_s_as_they_were_to_the_first_one_s():
    stiff = standing({}, stiffness=2 * A1.stiffness, damping=3 * A1.damping)
    own = load_expert("trot")
    law = own.for_robot(stiff).joint_law
    assert own.joint_law.limits is not None
    stiffness, damping = own.joint_law.gains_of(A1)
    assert law.gains_of(stiff) == pytest.approx((2 * stiffness, 3 * damping))
    assert law.limits == replace(own.joint_law.limits, stiffness=2 * stiffness)


def test_ranges_of_angles_hold_what_every_leg_needs():
    own = load_student("trot", "sparse_formula")
    front = standing({"FL": (0.1, 0.7, -1.5), "FR": (-0.1, 0.7, -1.5)})
    before, after = (dict(policy.readings.ranges) for policy in (own, own.for_robot(front)))
    low, high = before["q.thigh"]
    assert after["q.thigh"] == pytest.approx((low - 0.1, high))
    assert after["q.calf"] == before["q.calf"]


def test_refuses_networks_whose_actions_are_other_angles_there():
    with pytest.raises(InputError, match="action_scale"):
        load_expert("trot").for_robot(standing({}, action_scale=0.5))
    formulas = load_student("trot", "sparse_formula")
    other = formulas.for_robot(standing({}, action_scale=0.5))
    seen = np.zeros(len(formulas.observation_names))
    np.testing.assert_allclose(2 * other(seen), formulas(seen), atol=1e-9)


def test_refuses_a_robot_that_stands_beyond_its_limits():
    low, _ = GO2.position_limits["calf"]
    bent = standing({leg: (*GO2.stance[leg][:2], low) for leg in GO2.stance})
    assert TargetLimits(bent.stiffness).margin > 0
    with pytest.raises(InputError, match="stance"):
        load_expert("trot").for_robot(bent)
