"""Quantities in the robot's units, and definitions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glassgait.models.formulas.evaluate import Tape
from glassgait.models.formulas.expression import Expression
from glassgait.models.formulas.mirror import FormulaMirror
from glassgait.models.formulas.quantities import (
    RobotUnits,
    Vocabulary,
    actions_of,
    known_definitions,
)
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.library import load_robot, robot_names
from glassgait.models.task.ground import body_state
from glassgait.models.task.observation import ObservationLayout, proprioception, reflect_observation

A1 = load_robot()


NAMES = ObservationLayout(2).names
N = len(NAMES)
KNOWN = known_definitions(A1, NAMES)
VOCABULARY = Vocabulary(NAMES, KNOWN)


@pytest.fixture
def robots(random_states, generator):
    """The states, actions, commands and observations of twenty robots."""
    state = random_states(20)
    action, command = generator.normal(size=(20, 12)), generator.normal(size=(20, 2))
    own = proprioception(
        A1,
        command=command,
        joint_position=state[:, quadruped.JOINT_POSITION],
        joint_velocity=state[:, quadruped.JOINT_VELOCITY],
        previous_action=action,
        rm_state=np.eye(2)[np.arange(20) % 2],
        rm_iterations=np.arange(20.0) % 7,
        commanded_dwell=np.full(20, 6.0),
    )
    return state, action, command, np.concatenate([own, body_state(A1, state)], axis=1)


@pytest.fixture
def message(robots):
    """Evaluates variables by symbol, from the observations of `robots`."""
    observed = RobotUnits.of(A1, NAMES).quantities(robots[-1])
    values = np.concatenate(
        [observed, Tape([definition.formula for definition in KNOWN], N)(observed)], axis=1
    )
    return lambda *symbols: values[:, [VOCABULARY.symbols.index(s) for s in symbols]]


def of_joints(quantity):
    return [f"{quantity}.{joint}" for joint in quadruped.JOINTS]


def test_quantities_are_what_the_robot_is_and_does(robots, message):
    state, action, command, _ = robots
    for symbols, values in (
        (["cmd.v", "cmd.yaw"], command),
        (of_joints("q"), state[:, quadruped.JOINT_POSITION]),
        (of_joints("dq"), state[:, quadruped.JOINT_VELOCITY]),
        (of_joints("a"), A1.joint_targets(action)),
        (["s0", "s1"], np.eye(2)[np.arange(20) % 2]),
        (["t"], np.arange(20.0)[:, None] % 7),
        (["cmd.t"], np.full((20, 1), 6.0)),
        (["v.x", "v.y", "v.z"], kinematics.base_velocity(state)[0]),
        ([f"h.{leg}" for leg in quadruped.LEGS], kinematics.foot_heights(A1, state)),
    ):
        np.testing.assert_allclose(message(*symbols), values, rtol=1e-12, atol=1e-12)


def test_targets_and_actions_are_each_others_inverse(generator):
    action = generator.normal(size=(3, 5, 12))
    np.testing.assert_allclose(actions_of(A1, A1.joint_targets(action)), action, atol=1e-14)
    target = A1.joint_targets(action)
    np.testing.assert_allclose(A1.joint_targets(actions_of(A1, target)), target, atol=1e-14)
    np.testing.assert_array_equal(actions_of(A1, A1.default_stance), np.zeros(12))


def test_definitions_are_what_they_say(robots, message):
    _, _, command, _ = robots
    np.testing.assert_array_equal(message("phase"), message("t") / message("cmd.t"))
    assert (message("phase")[6], message("phase")[7]) == (1.0, 0.0)
    np.testing.assert_allclose(message("e.v"), command[:, :1] - message("v.x"), atol=1e-12)
    np.testing.assert_array_equal(message("late"), np.tanh(0.5 * message("t") - 2.0))
    for leg in quadruped.LEGS:
        height = message(f"h.{leg}")
        np.testing.assert_array_equal(message(f"lifted.{leg}"), np.tanh(100.0 * height - 2.0))
        side = A1.side[quadruped.LEGS.index(leg)]
        for part, sign in zip(quadruped.LEG_JOINTS, (side, 1.0, 1.0), strict=True):
            joint = f"{leg}_{part}"
            stance = A1.default_stance[quadruped.joint_index(joint)]
            above = np.tanh(sign * (message(f"a.{joint}") - stance) / 0.2)
            np.testing.assert_allclose(message(f"sent.{joint}"), above, atol=1e-12)


@pytest.mark.parametrize("imu", [False, True])
@pytest.mark.parametrize("robot", robot_names())
def test_every_definition_has_a_mirror_image_among_the_definitions(robot, imu):
    names = ObservationLayout(2, imu=imu).names
    vocabulary = Vocabulary(names, known_definitions(load_robot(robot), names))
    for states in ((0, 1), (1, 0)):
        mirror = FormulaMirror.of(vocabulary, states)
        quantities = np.random.default_rng(0).normal(size=(9, len(names)))
        images = [vocabulary.expanded(image) for image in mirror.variables[len(names) :]]
        own = [definition.formula for definition in vocabulary.definitions]
        np.testing.assert_array_equal(
            Tape(images, len(names))(quantities),
            Tape(own, len(names))(reflect_observation(names, states)(quantities)),
        )


def test_feet_are_where_kinematics_puts_them(robots, message):
    joints = robots[0][:, quadruped.JOINT_POSITION]
    thigh, _, foot = kinematics.leg_points(A1, kinematics.leg_angles(joints))
    from_hip = foot - thigh
    for i, leg in enumerate(quadruped.LEGS):
        hip = joints[:, 3 * i]
        up_in_plane = np.stack([np.zeros(20), -np.sin(hip), np.cos(hip)], axis=-1)
        forward, up = message(f"x.{leg}", f"z.{leg}").T
        np.testing.assert_allclose(forward, from_hip[:, i, 0], atol=1e-12)
        np.testing.assert_allclose(up, (from_hip[:, i] * up_in_plane).sum(axis=-1), atol=1e-12)
        assert (up < 0.0).any()


def test_definitions_are_put_in_where_they_are_used(generator):
    late, t, speed = (VOCABULARY.variable(symbol) for symbol in ("late", "t", "e.v"))
    formula = Expression("add", (Expression("mul", (late, speed)), Expression("sin", (t,))))
    expanded = VOCABULARY.expanded(formula)
    assert VOCABULARY.expanded(expanded) == expanded
    quantities = generator.normal(size=(9, N))
    values = Tape([definition.formula for definition in KNOWN], N)(quantities)
    whole = Tape([formula], N + len(KNOWN))(np.concatenate([quantities, values], axis=1))
    np.testing.assert_array_equal(Tape([expanded], N)(quantities), whole)


@given(data=st.data(), seed=st.integers(0, 2**32 - 1))
def test_leaving_out_what_is_not_used_changes_no_value(random_formulas, data, seed):
    formulas = data.draw(st.lists(random_formulas(len(VOCABULARY.symbols)), max_size=3))
    smaller, renamed = VOCABULARY.using(formulas)
    used = frozenset().union(*(formula.variables for formula in formulas))
    kept = [KNOWN[index - N] for index in sorted(used) if index >= N]
    assert smaller.names == NAMES
    assert list(smaller.definitions) == kept
    for old, new in zip(formulas, renamed, strict=True):
        assert smaller.expanded(new) == VOCABULARY.expanded(old)
        assert max(new.variables, default=0) < N + len(kept)
        assert {smaller.symbols[i] for i in new.variables} == {
            VOCABULARY.symbols[i] for i in old.variables
        }
