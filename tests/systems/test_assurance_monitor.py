"""The monitor that calls the expert."""

import numpy as np
import pytest
from pydrake.systems.framework import InputPortIndex

from glassgait.models.task.assurance import EnsembleDisagreement, Hysteresis, Region
from glassgait.models.task.observation import ObservationLayout
from glassgait.systems.assurance_monitor import AssuranceMonitor

EXPERT, STUDENT = InputPortIndex(1), InputPortIndex(2)
NAMES = ObservationLayout(2).names
SPEED = NAMES.index("Base Lin Vel Y")


@pytest.fixture
def system():
    region = Region(NAMES, np.full((2, 49), -1.0), np.full((2, 49), 1.0))
    return AssuranceMonitor(region, Hysteresis(0.1, 0.05, return_steps=2), EXPERT, STUDENT)


def observing(speed):
    observation = np.zeros(49)
    observation[SPEED] = speed
    return observation


def chosen(system, context):
    selected = system.get_port_selector_output_port().Eval(context)
    acts = system.get_expert_acts_output_port().Eval(context)[0]
    assert acts == (selected == EXPERT)
    return {EXPERT: "E", STUDENT: "S"}[selected]


def test_reports_how_far_outside_the_observation_is(system, fix_inputs):
    for speed, overrun in [(0.9, 0.0), (1.3, 0.15), (-2.0, 0.5)]:
        context = fix_inputs(system, observation=observing(speed))
        message = system.get_overrun_output_port().Eval(context)
        assert message[0] == pytest.approx(overrun)


def test_calls_the_expert_at_the_very_instant_and_lets_it_go_when_calm(system, fix_inputs, latch):
    context, chose = system.CreateDefaultContext(), ""
    for speed in (0.0, 1.3, 0.0, 1.15, 0.0, 0.0, 0.0):
        fix_inputs(system, context, observation=observing(speed))
        chose += chosen(system, context)
        # Asking again changes nothing: who acts is remembered by the update alone.
        assert chosen(system, context) == chose[-1]
        latch(system, context)
    # 1.15 is within the limit, but not within the smaller one, and the count begins anew.
    assert chose == "SEEEESS"


def test_clones_remember_for_themselves(system, fix_inputs, latch):
    context = fix_inputs(system, observation=observing(1.3))
    clone = context.Clone()
    latch(system, context)
    for own in (context, clone):
        fix_inputs(system, own, observation=observing(0.0))
    assert (chosen(system, context), chosen(system, clone)) == ("E", "S")
    # A fresh context is the start of an episode.
    assert chosen(system, fix_inputs(system, observation=observing(0.0))) == "S"


def test_an_observation_that_is_not_finite_calls_the_expert(system, fix_inputs):
    assert chosen(system, fix_inputs(system, observation=observing(np.nan))) == "E"


def test_a_student_that_disagrees_more_than_usual_is_relieved(system, fix_inputs):
    disagreement = EnsembleDisagreement(
        lambda seen: abs(seen[..., SPEED]), np.array([[0.3, 0.3], [0.5, 0.5]])
    )
    corner = np.full((2, 49), 1.0)
    region = Region(NAMES, -corner, corner, disagreement)
    disagreeing = AssuranceMonitor(region, Hysteresis(0.1, 0.05), EXPERT, STUDENT)
    for speed, who in [(0.5, "S"), (0.51, "S"), (0.6, "E")]:
        assert chosen(system, fix_inputs(system, observation=observing(speed))) == "S"
        context = fix_inputs(disagreeing, observation=observing(speed))
        assert chosen(disagreeing, context) == who
        message = disagreeing.get_overrun_output_port().Eval(context)
        assert message[0] == pytest.approx((speed - 0.5) / 0.2)
