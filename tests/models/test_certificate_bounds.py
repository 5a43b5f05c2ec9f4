"""Bounds of targets: no observation in a box exceeds one, and those of small formulas are exact."""

from itertools import product

import numpy as np
import pytest

from glassgait.models.certificates.box import ObservationBox, operating_box, physical_box
from glassgait.models.certificates.prover import Prover
from glassgait.models.certificates.targets import FormulaTargets, Query
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
    """Returns a policy with a formula for the first joint and 0 for the others."""
    others = "\n".join(f"{joint} = 0" for joint in quadruped.JOINTS[1:])
    head = "format: 2\ngait: trot\nstates: 2\nsenses: imu\n\nevery state"
    return FormulaPolicy.from_file(read_formulas(f"{head}\nFL_hip = {text}\n{others}\n"))


def greatest(text: str) -> tuple[float, float]:
    box = whole_box(load_gait("trot")).in_state(0)
    found = FormulaTargets(formulas(text)).bound(Query("target", 0, 0, 1), box, gap=1e-6)
    return found.bound, found.reached


@pytest.mark.parametrize(
    ("gait", "kind"),
    [pytest.param("trot", "formulas", marks=pytest.mark.slow), ("bound", "formulas")],
)
@pytest.mark.parametrize("box", [lambda gait: operating_box(gait, A1), whole_box])
def test_no_observation_of_a_box_breaks_a_bound(gait, kind, box):
    machine, policy = load_gait(gait), load_student(gait, kind)
    assert isinstance(policy, FormulaPolicy)
    whole, targets = box(machine), FormulaTargets(policy)
    quantities = whole.random(3_000, np.random.default_rng(7))
    units = RobotUnits.of(A1, policy.observation_names)
    reached = A1.joint_targets(policy(units.observed(quantities)))
    states = policy.observation_names.index("RM State 0")
    for state, joint in product(range(machine.n_states), (0, 8)):
        mine = reached[quantities[:, states + state] == 1.0, joint]
        for sign in (1, -1):
            query, held = Query("target", state, joint, sign), whole.in_state(state)
            found = targets.bound(query, held, gap=0.005 * WIDTHS[joint])
            assert (sign * mine).max() <= found.bound + targets.rounding(state, joint, held)


def test_a_witness_is_in_the_box_and_reaches_the_stated_value():
    gait, policy = load_gait("trot"), load_student("trot", "formulas")
    assert isinstance(policy, FormulaPolicy)
    box, units = operating_box(gait, A1).in_state(1), RobotUnits.of(A1, policy.observation_names)
    # For these joints, the search finds the bound before it gives up.
    for joint in (3, 8):
        query = Query("target", 1, joint, -1)
        found = FormulaTargets(policy).bound(query, box, gap=0.005 * WIDTHS[joint])
        assert np.all((box.lower <= found.witness) & (found.witness <= box.upper))
        value = A1.joint_targets(policy(units.observed(found.witness)))[joint]
        assert -value == pytest.approx(found.reached, abs=1e-8)
        assert found.bound - found.reached <= 0.01 * WIDTHS[joint]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0.5 + 2*cmd.v - cmd.yaw", 3.5),
        # A gate times an affine function peaks at a corner; h.FL is from -0.1 to 0.4 m in the box.
        ("tanh(100*h.FL - 2)*(1 + cmd.v)", 2.0),
        # The time is an integer: the square peaks at the ends, and is 0 after 4 control steps.
        ("-tanh(0.5*t - 2)*tanh(0.5*t - 2)", 0.0),
        # The squares cancel, although each has a wide range.
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
    # tanh(100 h - 2) - 3 h is greatest inside the box, where 100 (1 - tanh²) = 3.
    gate = np.sqrt(1.0 - 0.03)
    height = (np.arctanh(gate) + 2.0) / 100.0
    bound, reached = greatest("tanh(100*h.FL - 2) - 3*h.FL")
    assert bound >= gate - 3.0 * height
    assert bound == pytest.approx(gate - 3.0 * height, abs=0.05)
    assert reached <= gate - 3.0 * height + 1e-12


def test_a_formula_that_may_divide_by_nothing_has_no_bound():
    assert greatest("1/cmd.v")[0] == np.inf


def test_slopes_and_effects_of_a_gate():
    policy = formulas("tanh(100*h.FL - 2)*cmd.v + 0.2*cmd.yaw")
    targets, box = FormulaTargets(policy), whole_box(load_gait("trot")).in_state(0)
    slope = targets.bound(Query("slope", 0, 0, 1, 1), box, gap=1e-6)
    assert slope.bound == pytest.approx(0.2)
    effect = targets.bound(Query("effect", 0, 0, 1, 0), box, gap=1e-6)
    assert effect.bound == pytest.approx(2.0, abs=1e-5)
    assert len(effect.witness) == len(box.lower) + 1
    assert targets.used(0, 0) == {0, 1, policy.observation_names.index("Foot Height FL")}
    assert targets.used(0, 1) == frozenset()


def test_nothing_is_proved_of_a_network():
    with pytest.raises(InputError, match="are not proved"):
        Prover(load_expert("trot"), load_gait("trot"))
