"""Giving a policy another observation."""

import numpy as np
import pytest

from glassgait.systems.observation_offset import Intervention, ObservationOffset


@pytest.fixture
def system():
    return ObservationOffset(Intervention(np.array([0.5, -1.0, 0.0]), first=2, count=2))


def given(system, context):
    return system.get_given_observation_output_port().Eval(context)


def test_the_offset_is_there_while_the_intervention_lasts(system, fix_inputs):
    context = fix_inputs(system, observation=np.arange(3.0))
    for step in range(6):
        context.SetTime(step * 0.02)
        offset = [0.5, -1.0, 0.0] if step in (2, 3) else np.zeros(3)
        np.testing.assert_array_equal(given(system, context), np.arange(3.0) + offset)


def test_clones_go_by_their_own_time(system, fix_inputs):
    context = fix_inputs(system, observation=np.zeros(3))
    clone = context.Clone()
    clone.SetTime(0.04)
    np.testing.assert_array_equal(given(system, context), np.zeros(3))
    np.testing.assert_array_equal(given(system, clone), [0.5, -1.0, 0.0])
