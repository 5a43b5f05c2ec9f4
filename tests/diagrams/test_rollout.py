"""Rollouts of the diagram."""

import numpy as np
import pytest

from diagrams.locomotion import LocomotionConfig, MakeLocomotion
from diagrams.rollout import make_simulator, record
from diagrams.station import StationConfig


def test_records_every_control_step_without_drift(trot, make_policy):
    diagram = MakeLocomotion(trot, LocomotionConfig(), expert=make_policy(trot))
    rollout = record(make_simulator(diagram), 30, stop_on_failure=False)
    np.testing.assert_array_equal(rollout.time, 0.02 * np.arange(31))
    assert rollout["state"].shape == (31, 37)


def test_stops_at_the_first_failure(trot):
    diagram = MakeLocomotion(trot, LocomotionConfig())
    simulator = make_simulator(diagram)
    diagram.GetInputPort("actions").FixValue(simulator.get_mutable_context(), np.full(12, 10.0))
    rollout = record(simulator, 100)
    assert rollout.failed
    assert len(rollout.time) < 20


def test_stops_when_told(trot, make_policy):
    diagram = MakeLocomotion(trot, LocomotionConfig(), expert=make_policy(trot))
    answers = iter([False, False, True])
    rollout = record(make_simulator(diagram), 100, stopped=lambda: next(answers))
    assert len(rollout.time) == 3


@pytest.mark.slow
def test_the_error_controlled_integrator_runs_the_continuous_plant(trot, make_policy):
    config = LocomotionConfig(station=StationConfig(time_step=0.0))
    diagram = MakeLocomotion(trot, config, expert=make_policy(trot))
    rollout = record(make_simulator(diagram, accuracy=1e-3), 5, stop_on_failure=False)
    assert rollout["state"][-1][6] > 0.2
