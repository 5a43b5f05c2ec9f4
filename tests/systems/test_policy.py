"""A policy as a system."""

import numpy as np

from systems.policy import PolicySystem


def test_ports(trot, make_policy, port_sizes, feedthrough):
    system = PolicySystem(make_policy(trot))
    assert port_sizes(system) == ({"observation": 49}, {"action": 12})
    assert feedthrough(system) == {("observation", "action")}


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


def test_refuses_wrong_sizes(trot, make_policy, assert_sizes_are_checked):
    assert_sizes_are_checked(PolicySystem(make_policy(trot)))
