"""What the training page says of this side of each deviation from the paper's reference code."""

from pathlib import Path

import numpy as np
import pytest

from glassgait.diagrams.station import StationConfig
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task import observation
from glassgait.models.task.gait import gait_names, load_gait
from glassgait.models.task.randomization import Randomization
from glassgait.models.task.reward_machine import RewardMachine
from glassgait.models.task.termination import TerminationLimits, failures
from glassgait.models.task.terrain import PLANE
from glassgait.studies.training.config import PpoConfig

A1 = load_robot()


PAGE = Path(__file__).parents[2] / "studies" / "training" / "README.md"


@pytest.fixture(scope="module")
def compared():
    """What the page says of this project, by what it is about."""
    rows = [line.split(" | ") for line in PAGE.read_text().splitlines() if line.count(" | ") == 2]
    return {row[0].removeprefix("| "): row[1] for row in rows}


def row(compared, start):
    [found] = [here for what, here in compared.items() if what.startswith(start)]
    return found


def test_clearance_is_of_the_sole(compared):
    standing = kinematics.standing_state(A1, A1.default_stance[None])
    assert np.abs(kinematics.foot_heights(A1, standing)).min() < 1e-12
    assert A1.foot_radius == 0.02
    assert {load_gait(name).clearance for name in gait_names()} == {0.03}
    assert (
        row(compared, "a foot's clearance, 3 cm, and its greatest height, 25 cm") == "of the sole"
    )
    assert TerminationLimits().foot_height == 0.25


def test_a_state_ends_at_the_commanded_step(compared, trot):
    machine = RewardMachine(trot)
    state, fired = machine.initial((1,)), []
    contact = np.array([[True, False, False, True]])
    while not any(fired):
        step = machine.step(
            state,
            foot_contact=contact,
            foot_height=np.where(contact, 0.0, 0.1),
            commanded_dwell=np.array([6]),
        )
        state = step.machine
        fired.append(bool(step.fired[0]))
    assert len(fired) == 6
    assert "at the n-th step" in row(compared, "commanded dwell")


def test_commands_are_observed_as_they_are(compared):
    entries = observation.ObservationLayout(2).entries
    assert [(own.unit, own.scale(A1)) for own in entries[:2]] == [("m/s", 1.0), ("rad/s", 1.0)]
    assert observation.OVERDUE == 2
    assert row(compared, "observed commands") == "in m/s and rad/s"
    assert "two steps beyond" in row(compared, "observed time")


def test_an_episode_ends_where_the_page_says(compared):
    limits = TerminationLimits()
    assert row(compared, "a joint out of range").startswith(f"{limits.joint_overrun:g} rad beyond")
    assert row(compared, "a low trunk") == f"below {limits.trunk_height:.2f} m"
    assert row(compared, "a change of the action") == f"above {limits.action_change:g}, squared"
    assert limits.shank_share == 0.5
    state, still = kinematics.standing_state(A1, A1.default_stance[None]), np.zeros((1, 12))
    for beyond, fails in ((0.04, False), (0.06, True)):
        state[0, quadruped.JOINT_POSITION.start] = A1.upper_limits[0] + beyond
        shown = failures(A1, state, action=still, previous_action=still, limits=limits)
        assert shown[0, 2] == fails


def test_robots_start_on_their_lowest_foot(compared):
    states = Randomization().initial_states(A1, 50, np.random.default_rng(0))
    np.testing.assert_allclose(kinematics.foot_heights(A1, states).min(axis=1), 0.0, atol=1e-12)
    assert row(compared, "an episode's start") == "standing on the lowest foot"


def test_robot_and_networks_are_those_that_the_page_names(compared):
    assert row(compared, "motors' limits") == f"{A1.effort[0]} N·m"
    ppo = PpoConfig()
    assert ppo.actor_layers == ppo.critic_layers == (256, 128, 64)
    assert row(compared, "actor and critic") == "hidden layers of 256, 128 and 64"
    station = StationConfig()
    assert (station.contact_solver, station.time_step, station.terrain) == ("sap", 0.01, PLANE)
    assert row(compared, "ground") == "flat"
    walk = load_gait("walk")
    assert row(compared, "the walk's") == f"{walk.max_speed} m/s, {walk.max_yaw_rate:g} rad/s"
