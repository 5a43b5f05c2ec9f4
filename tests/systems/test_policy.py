"""A policy as a system."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, ZeroOrderHold

from glassgait.models.errors import InputError
from glassgait.models.formulas.text import parse_expression, variable_names
from glassgait.models.policies.symbolic import SymbolicPolicy
from glassgait.models.robots import quadruped
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.observation import ObservationLayout
from glassgait.systems.policy import PolicySystem


def test_gives_the_policys_action(trot, make_policy, fix_inputs, generator):
    policy = make_policy(trot)
    system = PolicySystem(policy)
    observation = generator.normal(size=49)
    context = fix_inputs(system, observation=observation)
    np.testing.assert_array_equal(
        system.get_action_output_port().Eval(context), policy(observation)
    )


def test_contexts_share_the_policy_but_not_the_observation(trot, make_policy, fix_inputs):
    system = PolicySystem(make_policy(trot))
    context = fix_inputs(system, observation=np.ones(49))
    clone = context.Clone()
    fix_inputs(system, clone, observation=np.zeros(49))
    np.testing.assert_array_equal(system.get_action_output_port().Eval(clone), 0)
    assert system.get_action_output_port().Eval(context).any()


def test_an_action_that_is_not_finite_ends_the_simulation_in_one_sentence():
    names = ObservationLayout(2).names
    formulas = [parse_expression("x0", variable_names(len(names)))] * quadruped.N_JOINTS
    formulas[2] = parse_expression("1 / x0", variable_names(len(names)))
    builder = DiagramBuilder()
    policy = builder.AddSystem(PolicySystem(SymbolicPolicy("trot", names, formulas)))
    source = builder.AddSystem(ConstantVectorSource(np.zeros(len(names))))
    hold = builder.AddSystem(ZeroOrderHold(CONTROL_PERIOD, quadruped.N_JOINTS, 3 * CONTROL_PERIOD))
    builder.Connect(source.get_output_port(), policy.get_observation_input_port())
    builder.Connect(policy.get_action_output_port(), hold.get_input_port())
    simulator = Simulator(builder.Build())
    message = "symbolic policy's action of FL_calf is not finite at control step 3"
    with pytest.raises(InputError, match=message):
        simulator.AdvanceTo(1.0)


def test_an_observation_that_is_not_finite_is_passed_on(trot, make_policy, fix_inputs):
    system = PolicySystem(make_policy(trot))
    context = fix_inputs(system, observation=np.full(49, np.nan))
    assert np.isnan(system.get_action_output_port().Eval(context)).all()
