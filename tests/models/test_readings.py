"""Ranges that sensed quantities are clipped to: their effects on files, policies and proofs."""

from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from glassgait.models.certificates.box import ObservationBox, operating_box
from glassgait.models.certificates.checker.bounds import Polynomials
from glassgait.models.certificates.checker.certificate import Check
from glassgait.models.certificates.checker.policy import FormulaFile
from glassgait.models.certificates.targets import FormulaTargets, Query
from glassgait.models.formulas.quantities import Readings, RobotUnits
from glassgait.models.formulas.reader import read_formulas
from glassgait.models.policies.library import load_student
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.gait import load_gait
from glassgait.models.task.observation import (
    REFLECT_JOINTS,
    ObservationLayout,
    entries_of,
    reflect_observation,
)
from glassgait.studies.distillation.formula_network import FormulaNetwork

A1 = load_robot()
TROT = load_gait("trot")
PAGE = load_student("trot", "formulas")
NAMES = ObservationLayout(2, imu=True).names
UNITS = RobotUnits.of(A1, NAMES)
SYMBOLS = [entry.symbol for entry in entries_of(NAMES)]
RANGES = """readings:
  cmd.v: [-1, 1]
  cmd.yaw: [-1, 1]
  q.hip: [-0.4, 0.8]
  q.thigh: [0, 2]
  q.calf: [-2.8, -1]
  dq.hip: [-10, 10]
  dq.thigh: [-10, 12]
  dq.calf: [-14, 14]
  g.x: [-0.4, 0.3]
  g.y: [-0.4, 0.4]
  g.z: [-1.1, -0.8]
  w.x: [-7, 7]
  w.y: [-6, 5]
  w.z: [-2, 2]
  v.x: [-1.5, 0.5]
  v.y: [-1, 1]
  v.z: [-0.5, 0.5]
  h: [-0.1, 0.25]
"""


def text_of(formula: str = "0.1", ranges: str = RANGES, *, joint: str = "FL_hip") -> str:
    """Writes a policy with a formula for one joint and 0 for the others."""
    lines = (f"{own} = {formula if own == joint else 0}\n" for own in quadruped.JOINTS)
    head = "format: 2\ngait: trot\nstates: 2\nsenses: imu\n"
    return f"{head}{ranges}\nevery state\n{''.join(lines)}"


def policy_of(formula: str, *, joint: str = "FL_hip") -> FormulaPolicy:
    return FormulaPolicy.from_file(read_formulas(text_of(formula, joint=joint)))


def observed(**quantities: float) -> np.ndarray:
    """Returns the observation of a robot in its default stance, with some quantities changed."""
    own = UNITS.offset.copy()
    own[SYMBOLS.index("g.z")], own[SYMBOLS.index("s0")] = -1.0, 1.0
    for symbol, value in quantities.items():
        own[SYMBOLS.index(symbol.replace("__", "."))] = value
    return UNITS.observed(own)


def target(policy: FormulaPolicy, joint: str = "FL_hip", **quantities: float) -> float:
    action = policy(observed(**quantities))
    return float(A1.joint_targets(action)[quadruped.joint_index(joint)])


@pytest.mark.parametrize(
    ("symbol", "said", "read"),
    [
        ("q__FL_hip", 2.0, 0.8),
        ("q__FL_hip", 0.5, 0.5),
        # The range of a right hip is the mirror image of a left hip's.
        ("q__FR_hip", -2.0, -0.8),
        ("q__FR_hip", 2.0, 0.4),
        ("q__RL_thigh", -1.0, 0.0),
        ("dq__RR_calf", 99.0, 14.0),
        ("w__y", 9.0, 5.0),
        ("h__RL", -1.0, -0.1),
        ("cmd__yaw", -3.0, -1.0),
        # Quantities that are not sensed are not clipped.
        ("a__FL_hip", 5.0, 5.0),
        ("t", 40.0, 40.0),
    ],
)
def test_formulas_read_the_nearer_end_of_a_range(symbol, said, read):
    policy = policy_of(symbol.replace("__", "."))
    assert target(policy, **{symbol: said}) == pytest.approx(read, abs=1e-12)
    seen = observed(**{symbol: said})
    index = SYMBOLS.index(symbol.replace("__", "."))
    assert policy.quantities(seen)[index] == pytest.approx(read, abs=1e-12)
    assert policy.explain(seen, "FL_hip").values.sum() == pytest.approx(read, abs=1e-12)
    slope = policy.derivatives(seen)[0, index]
    assert (slope != 0.0) == (said == read)


def test_torch_reads_as_the_policy_does():
    policy = policy_of("0.3*q.FL_hip*w.y - 0.2*h.RR + 0.1*dq.RL_calf")
    seen = np.random.default_rng(1).normal(scale=3.0, size=(50, len(NAMES)))
    seen[:, [SYMBOLS.index("s0"), SYMBOLS.index("s1")]] = [1.0, 0.0]
    actions = policy(seen)
    assert np.abs(actions - policy.with_readings(None)(seen)).max() > 1.0
    network = FormulaNetwork(policy)
    found = network(torch.tensor(seen, dtype=torch.float32)).detach().numpy()
    np.testing.assert_allclose(found, actions, atol=1e-4)
    assert network.to_policy().readings == policy.readings


def test_a_file_says_what_it_was_read_from():
    policy = policy_of("v.x + q.FL_hip")
    text = policy.to_text()
    assert "  q.hip: [-0.4, 0.8]\n" in text
    again = FormulaPolicy.from_file(read_formulas(text))
    assert (again.readings, again.digest()) == (policy.readings, policy.digest())
    assert policy.with_readings(None).digest() != policy.digest()


@given(
    st.lists(st.floats(-3, 3), min_size=len(NAMES), max_size=len(NAMES)),
    st.lists(st.floats(0.01, 3), min_size=len(NAMES), max_size=len(NAMES)),
)
def test_ranges_around_a_box_hold_it_and_have_no_side(lower, widths):
    low = np.array(lower)
    high = low + np.array(widths)
    least, greatest = Readings.around(NAMES, low, high).ends(NAMES)
    # Rounding outward ignores differences of less than a millionth of the last digit.
    assert (least <= low + 1e-7).all() and (greatest >= high - 1e-7).all()
    assert (greatest <= 1e3)[np.isfinite(least)].all() and np.isfinite(least).sum() == 33
    mirror = reflect_observation(NAMES, (1, 0))
    ends = np.sort([mirror(least), mirror(greatest)], axis=0)
    np.testing.assert_array_equal(ends, [least, greatest])


@given(st.integers(0, 2**32 - 1))
def test_a_page_is_its_own_mirror_image_wherever_sensors_are(seed):
    observations = np.random.default_rng(seed).normal(scale=5.0, size=(20, len(NAMES)))
    observations[:, [SYMBOLS.index("s0"), SYMBOLS.index("s1")]] = [1.0, 0.0]
    image = REFLECT_JOINTS(PAGE(reflect_observation(NAMES, (1, 0))(observations)))
    np.testing.assert_allclose(PAGE(observations), image, rtol=0, atol=1e-9)


# Boxes may extend beyond a range; such values are clipped.
FORMULAS = ("q.FL_hip*v.x - 2*tanh(v.x)", "v.x**2*q.FL_hip", "0.3 - q.FL_hip - v.x*v.y")


@pytest.mark.parametrize("formula", FORMULAS)
@pytest.mark.parametrize("seed", range(12))
def test_no_observation_of_a_box_breaks_a_bound(formula, seed):
    generator = np.random.default_rng(seed)
    angle, speed = zip(generator.uniform(-3, 3, 2), generator.uniform(0, 3, 2), strict=True)
    policy, sign = policy_of(formula), (1, -1)[seed % 2]
    region = _region({"q.FL_hip": angle, "v.x": speed})
    along = SYMBOLS.index("v.x")
    checker, formulas = _checked(policy)
    box = dict(zip(SYMBOLS, zip(region.lower, region.upper, strict=True), strict=True))
    drawn = generator.uniform(region.lower, region.upper, (200, len(SYMBOLS)))
    other = drawn.copy()
    other[:, along] = drawn[::-1, along]
    targets, moved = (_targets(policy, own) for own in (drawn, other))
    slopes = policy.derivatives(UNITS.observed(drawn))[:, 0, along]
    slopes *= A1.action_scale * UNITS.scale[along]
    cases: dict[Any, np.ndarray] = {"target": targets, "effect": targets - moved, "slope": slopes}
    for of, values in cases.items():
        asked = Query(of, 0, 0, sign, -1 if of == "target" else along)
        found = FormulaTargets(policy).bound(asked, region, gap=1e-4)
        assert (sign * values <= found.bound + 1e-9).all()
        assert found.reached <= found.bound + 1e-9
        ours = found.witness[: len(SYMBOLS)]
        assert (ours >= region.lower).all() and (ours <= region.upper).all()
        name, splits = "" if of == "target" else "v.x", _named(found.splits)
        bound = checker.greatest(sign * formulas[of], box, box, name, of == "slope", splits)
        assert bound <= found.bound + 1e-9
        assert (sign * values <= float(bound.upper()) + 1e-9).all()


def _region(ends: dict[str, tuple[float, float]]) -> ObservationBox:
    box = operating_box(TROT, A1).in_state(0)
    wider = {symbol: [low, low + width] for symbol, (low, width) in ends.items()}
    return ObservationBox.of_ranges(A1, NAMES, box.ranges | wider)


def _targets(policy: FormulaPolicy, quantities: np.ndarray) -> np.ndarray:
    return A1.joint_targets(policy(UNITS.observed(quantities)))[:, 0]


def _named(splits: list) -> list:
    """Replaces the indices in a tree of splits by names, as in a certificate."""
    if not splits:
        return []
    index, cut, below, above = splits
    return [[*SYMBOLS, "other"][index], cut, _named(below), _named(above)]


def _checked(policy: FormulaPolicy) -> tuple[Check, dict[str, Any]]:
    """Returns a check of a policy, with the target, effect and slope by v.x of its first joint."""
    own, text = Check.__new__(Check), policy.with_machine(TROT).to_text()
    own.file, own.polynomials = FormulaFile(text, SYMBOLS), Polynomials(SYMBOLS)
    target = own.file.evaluate(own.polynomials, "FL_hip", 0)
    moved = own.file.evaluate(own.polynomials.moving("v.x"), "FL_hip", 0)
    slope = own.polynomials.slope(target, "v.x")
    return own, {"target": target, "effect": target - moved, "slope": slope}


def test_a_sensor_stuck_beyond_its_range_moves_a_target_as_far_as_its_end():
    policy = policy_of("2*w.y")
    region = _region({"w.y": (-20.0, 40.0)})
    index = SYMBOLS.index("w.y")
    found = FormulaTargets(policy).bound(Query("effect", 0, 0, 1, index), region, gap=1e-6)
    assert found.bound == pytest.approx(22.0) and found.reached == pytest.approx(22.0)
    free = policy.with_readings(None)
    found = FormulaTargets(free).bound(Query("effect", 0, 0, 1, index), region, gap=1e-6)
    assert found.bound == pytest.approx(80.0)
