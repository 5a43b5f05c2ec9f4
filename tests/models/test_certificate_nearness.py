"""A witness beside what a robot observed: which inputs count, and which moment is nearest."""

import numpy as np
import pytest

from glassgait.models.certificates.claims import Claim
from glassgait.models.certificates.nearness import box_of, nearness, observation_of, overruns
from glassgait.models.certificates.observation_box import operating_box, physical_box
from glassgait.models.certificates.prover import Prover, Verdict
from glassgait.models.certificates.question import targets_of
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.policies.linear import LinearPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.gait import load_gait
from glassgait.models.task.observation import ObservationLayout, entries_of

A1 = load_robot()


GAIT = load_gait("trot")
NAMES = ObservationLayout(2, imu=True).names
SYMBOLS = [entry.symbol for entry in entries_of(NAMES)]
BOXES = {
    "operating": operating_box(GAIT, A1),
    "physical": physical_box(GAIT, operating_box(GAIT, A1)),
}
SEEN = ("v.x", "h.FL")


@pytest.fixture(scope="module")
def policy():
    """A policy whose front left thigh sees two observations, and whose other joints see none."""
    weights = np.zeros((quadruped.N_JOINTS, len(NAMES)))
    weights[1, [SYMBOLS.index(symbol) for symbol in SEEN]] = 1.0, 20.0
    return LinearPolicy("trot", NAMES, weights, np.zeros(quadruped.N_JOINTS))


@pytest.fixture(scope="module")
def refuted(policy):
    claim = Claim("The front left thigh stays", "limits", joints=("FL_thigh",), most=0.9)
    verdict = Prover(policy, GAIT, BOXES["operating"]).decide(claim)
    assert verdict is not None
    assert verdict.outcome == "refuted"
    return verdict


def moments(verdict, changes, state=None):
    """Returns observations that are the witness but for changes in widths of the operating box."""
    witness = observation_of(A1, verdict.witnesses[0], NAMES)
    observed = np.tile(witness, (len(changes), 1))
    widths = BOXES["operating"].upper - BOXES["operating"].lower
    for own, change in zip(observed, changes, strict=True):
        for symbol, share in change.items():
            own[SYMBOLS.index(symbol)] += share * widths[SYMBOLS.index(symbol)]
    if state is not None:
        observed[:, [SYMBOLS.index("s0"), SYMBOLS.index("s1")]] = np.eye(2)[state]
    return observed


def test_a_witness_is_observed_as_the_robot_would(policy, refuted):
    witness = observation_of(A1, refuted.witnesses[0], NAMES)
    quantities = dict(zip(SYMBOLS, RobotUnits.of(A1, NAMES).quantities(witness), strict=True))
    assert quantities == pytest.approx(refuted.witnesses[0])
    assert A1.joint_targets(policy(witness))[1] == pytest.approx(refuted.worst)
    assert refuted.worst > 0.9


def test_the_nearest_moment_is_nearest_in_widths_of_the_inputs_that_count(policy, refuted):
    changes = [{"v.x": 0.3, "h.FL": 0.4}, {"v.x": 0.1}, {"h.FL": 0.2}, {"v.y": 0.9, "v.x": 0.05}]
    found = nearness(refuted, BOXES, targets_of(policy), moments(refuted, changes))
    assert {SYMBOLS[index] for index in found.inputs} == set(SEEN)
    np.testing.assert_allclose(found.distances, [0.5, 0.1, 0.2, 0.05])
    assert found.nearest == 3
    assert found.diagonal == pytest.approx(2**0.5)


def test_moments_of_another_state_are_never_near(policy, refuted):
    observed = moments(refuted, [{}, {"v.x": 0.4}])
    state = observed[0, [SYMBOLS.index("s0"), SYMBOLS.index("s1")]].argmax()
    observed[0] = moments(refuted, [{}], 1 - state)[0]
    found = nearness(refuted, BOXES, targets_of(policy), observed)
    assert np.isinf(found.distances[0])
    assert found.nearest == 1
    elsewhere = moments(refuted, [{}, {}], 1 - state)
    assert nearness(refuted, BOXES, targets_of(policy), elsewhere).nearest is None


def test_of_two_witnesses_the_nearer_one_counts(policy):
    claim = Claim("t", "effect", joints=("FL_thigh",), observations=("h.FL",), most=0.1)
    verdict = Prover(policy, GAIT, BOXES["operating"]).decide(claim)
    assert verdict is not None
    assert len(verdict.witnesses) == 2
    last = Verdict(claim, "refuted", 1.0, 0.1, verdict.where, verdict.witnesses[1:])
    found = nearness(verdict, BOXES, targets_of(policy), moments(last, [{"v.x": 0.2}]))
    np.testing.assert_allclose(found.distances, [0.2])


def test_torque_is_decided_by_the_joints_own_angle_too(policy):
    claim = Claim("t", "torque", joints=("FL_thigh",), most=0.1)
    verdict = Prover(policy, GAIT, BOXES["operating"]).decide(claim)
    assert verdict is not None
    found = nearness(verdict, BOXES, targets_of(policy), moments(verdict, [{}]))
    assert {SYMBOLS[index] for index in found.inputs} == {*SEEN, "q.FL_thigh"}


def test_a_stuck_sensor_is_measured_by_the_physical_box(policy, refuted):
    claim = Claim("t", "limits", joints=("FL_thigh",), most=0.9, stuck=("h.FL",))
    height = SYMBOLS.index("h.FL")
    box = box_of(claim, BOXES)
    assert box.lower[height] == BOXES["physical"].lower[height]
    assert box.lower[0] == BOXES["operating"].lower[0]
    own = Verdict(claim, "refuted", refuted.worst, 0.9, refuted.where, refuted.witnesses)
    found = nearness(own, BOXES, targets_of(policy), moments(refuted, [{"h.FL": 1.0}]))
    shares = [np.subtract(*BOXES[name].quantities)[height] for name in ("operating", "physical")]
    np.testing.assert_allclose(found.distances, [shares[0] / shares[1]], rtol=1e-6)


def test_overruns_are_of_observations_outside_of_the_box():
    box = BOXES["operating"]
    inside = box.random(20, np.random.default_rng(2))
    assert not overruns(box, inside).any()
    outside, height = inside.copy(), SYMBOLS.index("h.RR")
    outside[3, height] = box.upper[height] + 0.25 * (box.upper - box.lower)[height]
    found = overruns(box, outside)
    assert found[3, height] == pytest.approx(0.25)
    assert np.count_nonzero(found) == 1


def test_the_ends_of_the_box_are_inside_of_it():
    box = BOXES["operating"]
    for corner in (box.lower, box.upper):
        one = box.in_state(0).clipped(corner)
        units = RobotUnits.of(A1, NAMES)
        again = units.observed(units.quantities(one))
        assert not overruns(box, again[None]).any()
