"""Rollouts of the diagram."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder, EventStatus

import glassgait.diagrams.rollout
from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import (
    find_locomotion,
    make_simulator,
    push,
    record,
    set_plant_state,
)
from glassgait.diagrams.scenario import Scenario
from glassgait.models.errors import InputError
from glassgait.models.robots import quadruped

CALM = Scenario(command=FixedCommand(), sensor_noise=0.0, true_body_state=True)


def test_records_every_control_step_without_drift(trot, make_policy):
    diagram = MakeLocomotion(trot, CALM, policy=make_policy(trot))
    rollout = record(make_simulator(diagram), 30, stop_on_failure=False)
    np.testing.assert_array_equal(rollout.time, 0.02 * np.arange(31))
    frame = rollout.to_frame()
    assert len(frame) == 31 and len(frame.columns) == 1 + sum(
        own.shape[1] for own in rollout.values()
    )
    np.testing.assert_array_equal(frame["state_36"], rollout["state"][:, 36])
    with pytest.raises(KeyError, match="recorded are action, observation, reward"):
        rollout["actions"]


def test_stops_at_a_monitors_request(trot, make_policy):
    diagram = MakeLocomotion(trot, CALM, policy=make_policy(trot))
    answers = iter([False, False, True])
    rollout = record(make_simulator(diagram), 100, stopped=lambda: next(answers))
    assert len(rollout.time) == 3


@pytest.fixture
def trotting(trot, make_policy):
    """The diagram of a robot that moves its legs, with noise."""
    return MakeLocomotion(trot, replace(CALM, sensor_noise=1.0), policy=make_policy(trot))


def nested(diagram):
    builder = DiagramBuilder()
    builder.AddNamedSystem("robot", diagram)
    return builder.Build()


def test_goes_on_where_the_simulator_is(trotting):
    whole = record(make_simulator(trotting), 12)
    simulator = make_simulator(trotting)
    first, second = record(simulator, 5), record(simulator, 7)
    np.testing.assert_array_equal([*first.time, *second.time[1:]], whole.time)
    assert second.time[0] == first.time[-1]
    np.testing.assert_array_equal(second["observation"], whole["observation"][5:])


@pytest.mark.parametrize(
    ("time", "n_steps", "key"),
    [
        (0.03, 1, "control instant"),
        (0.02 + 1e-15, 1, "control instant"),
        (0.0, -1, "n_steps is -1"),
    ],
)
def test_starts_at_control_instants_alone_and_takes_no_negative_steps(trotting, time, n_steps, key):
    simulator = make_simulator(trotting)
    simulator.AdvanceTo(time)
    with pytest.raises(InputError, match=key):
        record(simulator, n_steps)


def test_times_that_a_sum_makes_a_little_short_are_control_instants(trotting):
    simulator = make_simulator(trotting)
    simulator.AdvanceTo(0.7)
    assert 35 * 0.02 > 0.7
    np.testing.assert_array_equal(record(simulator, 1).time, [0.7, 36 * 0.02])


def test_without_an_end_it_keeps_the_last_steps(trotting, monkeypatch):
    monkeypatch.setattr(glassgait.diagrams.rollout, "KEPT_STEPS", 4)
    whole = record(make_simulator(trotting), 9)
    asked = iter(range(100))
    rollout = record(make_simulator(trotting), None, stopped=lambda: next(asked) == 9)
    np.testing.assert_array_equal(rollout.time, whole.time[5:])
    for port, values in whole.items():
        np.testing.assert_array_equal(rollout[port], values[5:])


def test_a_robot_in_a_larger_diagram_does_the_same(trotting):
    alone = record(make_simulator(trotting, seed=4), 10)
    part = record(make_simulator(nested(trotting), seed=4), 10)
    recorded = set(glassgait.diagrams.rollout.RECORDED_PORTS)
    assert set(part) == set(alone) == recorded
    for port, values in alone.items():
        np.testing.assert_array_equal(part[port], values)


def test_a_monitor_between_two_control_instants_ends_the_recording(trotting):
    simulator = make_simulator(trotting)

    def monitor(context):
        if context.get_time() >= 0.05:
            return EventStatus.ReachedTermination(trotting, "enough")
        return EventStatus.DidNothing()

    simulator.set_monitor(monitor)
    np.testing.assert_array_equal(record(simulator, None).time, [0.0, 0.02, 0.04])


def test_the_robot_is_placed_and_pushed_in_any_diagram_that_holds_it(trot, standing):
    diagram = MakeLocomotion(trot, CALM)
    whole = nested(nested(diagram))
    assert find_locomotion(whole) is diagram
    root = whole.CreateDefaultContext()
    context = diagram.GetMyMutableContextFromRoot(root)
    for i, part in enumerate([whole, diagram]):
        standing[4] = i
        set_plant_state(part, root, standing)
        push(part, root, np.array([0.5, 0.0, i]))
        state = diagram.GetOutputPort("state").Eval(context)
        np.testing.assert_array_equal(state[: quadruped.LINEAR_VELOCITY.start], standing[:22])
        np.testing.assert_array_equal(state[quadruped.LINEAR_VELOCITY], [0.5, 0.0, i])


def test_states_and_pushes_that_drake_would_not_survive_are_refused(trotting):
    context = make_simulator(trotting).get_mutable_context()
    for state in (np.zeros(36), np.full(37, np.nan)):
        with pytest.raises(InputError, match=r"state is .*; give 37 finite numbers"):
            make_simulator(trotting, state=state)
    for velocity in ([np.nan, 0.0, 0.0], np.zeros(2)):
        with pytest.raises(InputError, match=r"velocity is .*; give 3 finite numbers"):
            push(trotting, context, velocity)


def test_diagrams_of_two_robots_are_refused(trot):
    diagram, other = (MakeLocomotion(trot, CALM) for _ in range(2))
    builder = DiagramBuilder()
    for name, robot in (("one", diagram), ("two", other)):
        builder.AddNamedSystem(name, robot)
    with pytest.raises(InputError, match="contains 2 diagrams from MakeLocomotion"):
        find_locomotion(builder.Build())
