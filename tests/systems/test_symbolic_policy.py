"""Policies in Drake's symbols."""

from functools import cache

import numpy as np
import pytest
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import make_simulator, record
from glassgait.diagrams.scenario import Scenario
from glassgait.models.errors import InputError
from glassgait.models.formulas.grammar import parse_expression, variable_names
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import (
    load_expert,
    load_student,
    shipped_experts,
    shipped_students,
)
from glassgait.models.policies.linear import LinearPolicy, OpenLoopPolicy, StatewiseLinearPolicy
from glassgait.models.policies.symbolic import StatewiseSymbolicPolicy, SymbolicPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.gait import gait_names, load_gait
from glassgait.models.task.observation import (
    ITERATIONS_SCALE,
    ObservationLayout,
    machine_state_entries,
)
from glassgait.systems.symbolic_policy import make_symbolic_policy

A1 = load_robot()


TREES = ("ebm", "gbm")
FAST = ("symbolic", "statewise_linear", "sparse_formula")
READABLE = [
    pytest.param(gait, kind, marks=() if gait == "trot" and kind in FAST else pytest.mark.slow)
    for gait in gait_names()
    for kind in shipped_students(gait)
    if not kind.startswith(TREES)
]
NAMES = ObservationLayout(4).names
STATES = machine_state_entries(NAMES)
ITERATIONS = NAMES.index("RM Iters")


def observations(names, count=20, seed=2):
    """Random observations, the machine in a state and a whole number of steps in it."""
    generator = np.random.default_rng(seed)
    drawn = generator.normal(size=(count, len(names)))
    states = machine_state_entries(names)
    n_states = states.stop - states.start
    drawn[:, states] = np.eye(n_states)[generator.integers(n_states, size=count)]
    drawn[:, names.index("RM Iters")] = ITERATIONS_SCALE * generator.integers(12, size=count)
    return drawn


def act(system, observation):
    context = system.CreateDefaultContext()
    system.get_input_port().FixValue(context, observation)
    return system.get_output_port().Eval(context)


def slopes(system, observation):
    """The gradient (12, n) that the system's AutoDiffXd twin gives."""
    action = act(system.ToAutoDiffXd(), InitializeAutoDiff(observation)[:, 0])
    np.testing.assert_allclose(ExtractValue(action)[:, 0], act(system, observation), atol=1e-14)
    gradient = ExtractGradient(action)
    return gradient if gradient.size else np.zeros((len(action), len(observation)))


def differences(policy, observation, step=1e-6):
    """The gradient (12, n) by central differences."""
    shifts = step * np.eye(len(observation))
    return (policy(observation + shifts) - policy(observation - shifts)).T / (2 * step)


def assert_acts_as(policy, seen):
    system = make_symbolic_policy(policy)
    for observation in seen:
        np.testing.assert_allclose(
            act(system, observation), policy(observation), rtol=1e-12, atol=1e-12
        )


@cache
def student(gait, kind):
    return load_student(gait, kind)


def open_loop(n_iterations=7):
    table = np.random.default_rng(4).normal(size=(4, n_iterations, quadruped.N_JOINTS))
    return OpenLoopPolicy("walk", NAMES, table)


def linear(kind):
    generator = np.random.default_rng(4)
    states = (4,) if kind is StatewiseLinearPolicy else ()
    shape = (*states, quadruped.N_JOINTS)
    return kind(
        "walk",
        NAMES,
        weights=generator.normal(size=(*shape, len(NAMES))),
        intercepts=generator.normal(size=shape),
    )


def formulas(text):
    return [parse_expression(text, variable_names(len(NAMES)))] * quadruped.N_JOINTS


@pytest.mark.parametrize(("gait", "kind"), READABLE)
def test_shipped_policies_act_the_same_on_random_observations(gait, kind):
    policy = student(gait, kind)
    seen = observations(policy.observation_names)
    assert_acts_as(policy, seen)
    # And where no entry of the machine's state is 1, the greatest counts.
    assert_acts_as(policy, np.random.default_rng(1).normal(size=seen.shape))


@pytest.mark.parametrize(("gait", "kind"), READABLE)
def test_shipped_policies_act_the_same_on_what_the_robot_observes(gait, kind):
    policy = student(gait, kind)
    scenario = Scenario(command=FixedCommand(speed=0.25), sensor_noise=0.0)
    controller = alone(policy, load_expert(gait))
    diagram = MakeLocomotion(load_gait(gait), scenario, policy=controller)
    seen = record(make_simulator(diagram), 60, stop_on_failure=False)["observations"]
    states = seen[:, machine_state_entries(policy.observation_names)]
    assert len(np.unique(states, axis=0)) > 1
    assert_acts_as(policy, seen)


@pytest.mark.parametrize(("gait", "kind"), READABLE)
def test_gradients_of_shipped_policies_are_their_slopes(gait, kind):
    policy = student(gait, kind)
    system = make_symbolic_policy(policy)
    for observation in observations(policy.observation_names, count=4):
        found = slopes(system, observation)
        scale = 1 + np.abs(found).max()
        np.testing.assert_allclose(found, differences(policy, observation), atol=1e-6 * scale)
        if isinstance(policy, SymbolicPolicy | StatewiseSymbolicPolicy):
            np.testing.assert_allclose(found, policy.derivatives(observation), atol=1e-12 * scale)


@pytest.mark.parametrize("kind", [LinearPolicy, StatewiseLinearPolicy])
def test_linear_policies_act_the_same_and_slope_by_their_weights(kind):
    policy = linear(kind)
    assert_acts_as(policy, observations(NAMES))
    (observation,) = observations(NAMES, count=1)
    weights = policy.weights
    if kind is StatewiseLinearPolicy:
        weights = weights[np.argmax(observation[STATES])]
    np.testing.assert_allclose(
        slopes(make_symbolic_policy(policy), observation), weights, atol=1e-13
    )


@pytest.mark.parametrize("n_iterations", [1, 2, 7, 8])
def test_open_loops_are_looked_up_and_do_not_slope(n_iterations):
    policy = open_loop(n_iterations)
    seen = np.zeros((4 * 12, len(NAMES)))
    seen[:, STATES] = np.repeat(np.eye(4), 12, axis=0)
    # From before the table's first entry to beyond its last.
    seen[:, ITERATIONS] = np.tile(ITERATIONS_SCALE * np.arange(-1, 11), 4)
    assert_acts_as(policy, seen)
    np.testing.assert_array_equal(slopes(make_symbolic_policy(policy), seen[3]), 0)


def test_a_default_context_acts_as_well():
    for policy in (linear(StatewiseLinearPolicy), open_loop()):
        assert_acts_as(policy, np.zeros((1, len(NAMES))))


def test_only_the_formulas_of_the_state_that_is_on_are_evaluated():
    rows = [formulas(text) for text in ("x0", "1 / x0", "log(x0)", "sqrt(x0)")]
    system = make_symbolic_policy(StatewiseSymbolicPolicy("walk", NAMES, rows))
    observation = np.zeros(len(NAMES))
    observation[STATES] = [1, 0, 0, 0]
    # The first variable is a speed in m/s, the formula's value a target in rad.
    expected = -A1.default_stance / A1.action_scale
    np.testing.assert_allclose(act(system, observation), expected)
    np.testing.assert_allclose(slopes(system, observation)[:, 0], 1 / A1.action_scale)


@pytest.mark.parametrize(
    "text",
    [
        *("-(x0)", "x0 + x1", "x0 - x1", "x0 * x1", "x0 / x1", "x0 ^ 2", "x0 ^ 3"),
        *(f"{name}(x0)" for name in ("sin", "cos", "tanh", "exp", "log", "sqrt", "abs")),
        *("square(x0)", "cube(x0)", "0.5", "tanh(x0 + 2 * x1) / (x2 - 3)"),
    ],
)
def test_every_operator_acts_and_slopes_the_same(text):
    policy = SymbolicPolicy("walk", NAMES, formulas(text))
    seen = np.abs(observations(NAMES, count=5))
    assert_acts_as(policy, seen)
    np.testing.assert_allclose(
        slopes(make_symbolic_policy(policy), seen[0]), policy.derivatives(seen[0]), atol=1e-12
    )


def test_inputs_are_called_as_the_observations_are():
    system = make_symbolic_policy(SymbolicPolicy("walk", NAMES, formulas("x0 / x14")))
    assert (system.get_input_port().size(), system.get_output_port().size()) == (len(NAMES), 12)
    with pytest.raises(RuntimeError, match="Command X / "):
        act(system, np.zeros(len(NAMES)))


def test_networks_and_trees_are_refused():
    gait = shipped_experts()[0]
    policies = [load_expert(gait)]
    policies += [load_student(gait, kind) for kind in shipped_students(gait) if kind in TREES]
    assert len(policies) == 3
    for policy in policies:
        with pytest.raises(InputError, match=f"a {policy.kind} policy has no formulas; make"):
            make_symbolic_policy(policy)


def test_formulas_that_have_no_value_anywhere_are_refused():
    for text in ("x0 + log(-1)", "1 / (2 - 2)"):
        with pytest.raises(InputError, match="FL_hip"):
            make_symbolic_policy(SymbolicPolicy("walk", NAMES, formulas(text)))
