"""Bounds of targets: no observation of a box breaks one, and those of small policies are exact."""

from itertools import product

import numpy as np
import pytest

from glassgait.models.certificates.formula_targets import FormulaTargets
from glassgait.models.certificates.observation_box import (
    ObservationBox,
    operating_box,
    physical_box,
)
from glassgait.models.certificates.prover import Prover
from glassgait.models.certificates.question import BoundQuery, region_of
from glassgait.models.errors import InputError
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.formulas.reader import read_formulas
from glassgait.models.policies.library import load_expert, load_student
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.gait import Gait, load_gait

A1 = load_robot()


WIDTHS = A1.upper_limits - A1.lower_limits


def whole_box(gait: Gait) -> ObservationBox:
    return physical_box(gait, operating_box(gait, A1))


def formulas(text: str) -> FormulaPolicy:
    """A policy whose first joint has a formula, and the others none to speak of."""
    others = "\n".join(f"{joint} = 0" for joint in quadruped.JOINTS[1:])
    head = "format: 1\ngait: trot\nstates: 2\nsenses: imu\n\nevery state"
    return FormulaPolicy.from_file(read_formulas(f"{head}\nFL_hip = {text}\n{others}\n"))


def greatest(text: str) -> tuple[float, float]:
    region = region_of(whole_box(load_gait("trot")), 0)
    found = FormulaTargets(formulas(text)).answer(BoundQuery("target", 0, 0, 1), region, gap=1e-6)
    return found.bound, found.reached


@pytest.mark.parametrize(
    ("gait", "kind"),
    [
        pytest.param("trot", "sparse_formula", marks=pytest.mark.slow),
        ("bound", "sparse_formula"),
    ],
)
@pytest.mark.parametrize("box", [lambda gait: operating_box(gait, A1), whole_box])
def test_no_observation_of_a_box_breaks_a_bound(gait, kind, box):
    machine, policy = load_gait(gait), load_student(gait, kind)
    whole, targets = box(machine), FormulaTargets(policy)
    observations = whole.random(3_000, np.random.default_rng(7))
    assert np.array_equal(whole.clipped(observations), observations)
    reached = A1.joint_targets(policy(observations))
    states = policy.observation_names.index("RM State 0")
    for state, joint in product(range(machine.n_states), (0, 8)):
        mine = reached[observations[:, states + state] == 1.0, joint]
        for sign in (1, -1):
            question = BoundQuery("target", state, joint, sign)
            region = region_of(whole, state)
            found = targets.answer(question, region, gap=0.005 * WIDTHS[joint])
            assert (sign * mine).max() <= found.bound + targets.rounding(state, joint, region)


def test_a_witness_is_in_the_box_and_reaches_what_is_said():
    gait, policy = load_gait("trot"), load_student("trot", "sparse_formula")
    box, units = operating_box(gait, A1), RobotUnits.of(A1, policy.observation_names)
    region, targets = region_of(box, 1), FormulaTargets(policy)
    # Of these joints the page's search ends before it gives up.
    for of, joint in (("target", 3), ("offset", 7), ("target", 8)):
        found = targets.answer(BoundQuery(of, 1, joint, -1), region, gap=0.005 * WIDTHS[joint])
        assert np.all((region.lower <= found.witness) & (found.witness <= region.upper))
        action = policy(units.observed(found.witness))
        value = A1.joint_targets(action)[joint]
        value -= found.witness[2 + joint] if of == "offset" else 0.0
        assert -value == pytest.approx(found.reached, abs=1e-8)
        assert found.bound - found.reached <= 0.01 * WIDTHS[joint]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0.5 + 2*cmd.v - cmd.yaw", 3.5),
        # A gate times what is affine peaks at a corner; the box of h.FL is from -0.1 to 0.4 m.
        ("tanh(100*h.FL - 2)*(1 + cmd.v)", 2.0),
        # The clock is whole: a square peaks at its ends, and is 0 at 4 control steps.
        ("-tanh(0.5*t - 2)*tanh(0.5*t - 2)", 0.0),
        # Cancels, though each half has a wide range.
        ("(q.FL_hip + cmd.v)**2 - q.FL_hip**2 - 2*q.FL_hip*cmd.v", 1.0),
        ("sin(q.FL_thigh)", 1.0),
        ("cmd.v*cmd.yaw*v.x", 3.0),
        ("1/(2 + cmd.v)", 1.0),
    ],
)
def test_the_greatest_value_of_a_small_formula_is_known(text, expected):
    bound, reached = greatest(text)
    assert bound >= expected - 1e-12
    assert bound == pytest.approx(expected, abs=2e-6)
    assert reached == pytest.approx(expected, abs=1e-6)


def test_quantities_that_stand_twice_are_split():
    # tanh(100 h - 2) - 3 h has its greatest value inside, where 100 (1 - tanh²) = 3.
    gate = np.sqrt(1.0 - 0.03)
    height = (np.arctanh(gate) + 2.0) / 100.0
    bound, reached = greatest("tanh(100*h.FL - 2) - 3*h.FL")
    assert bound >= gate - 3.0 * height
    assert bound == pytest.approx(gate - 3.0 * height, abs=0.05)
    assert reached <= gate - 3.0 * height + 1e-12


def test_a_formula_that_may_divide_by_nothing_has_no_bound():
    assert greatest("1/cmd.v")[0] == np.inf


def test_slopes_and_effects_of_a_gate():
    gait, policy = load_gait("trot"), formulas("tanh(100*h.FL - 2)*cmd.v + 0.2*cmd.yaw")
    targets, region = FormulaTargets(policy), region_of(whole_box(gait), 0)
    slope = targets.answer(BoundQuery("slope", 0, 0, 1, 1), region, gap=1e-6)
    assert slope.bound == pytest.approx(0.2)
    effect = targets.answer(BoundQuery("effect", 0, 0, 1, 0), region, gap=1e-6)
    assert effect.bound == pytest.approx(2.0, abs=1e-5)
    assert len(effect.witness) == len(region.lower) + 1
    assert targets.used(0, 0) == {0, 1, policy.observation_names.index("Foot Height FL")}
    assert targets.used(0, 1) == frozenset()


def test_nothing_is_proved_of_a_network():
    with pytest.raises(InputError, match="are not proved"):
        Prover(load_expert("trot"), load_gait("trot"))
