"""The system that a compiled controller acts by."""

import numpy as np
import pytest

from glassgait.models.export.binding import ACTION, BAD_INPUT, Sensors
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.command import Command
from glassgait.models.task.imu import GRAVITY
from glassgait.systems.compiled_controller import CompiledController

A1 = load_robot()
AT_REST = np.array([0, 0, 0, 0, 0, CONTROL_PERIOD * GRAVITY, 0, 0, -1.0])


def sensed(state):
    """What sensors give of a robot that stands."""
    joints = [state[quadruped.JOINT_POSITION], state[quadruped.JOINT_VELOCITY]]
    return {"joints": np.concatenate(joints), "touching": np.ones(4)}


@pytest.fixture
def system(compiled_page) -> CompiledController:
    return CompiledController(compiled_page)


def outputs(system, context):
    ports = ("action", "targets", "status")
    return [system.GetOutputPort(name).Eval(context) for name in ports]


def test_takes_the_controllers_step_and_remembers(
    system, compiled_page, fix_inputs, latch, standing
):
    context = fix_inputs(
        system, **sensed(standing), imu=AT_REST, command=[0.5, 0.1], commanded_dwell=8
    )
    sensors, command = (
        Sensors(A1.default_stance, np.zeros(12), np.ones(4, bool), AT_REST),
        Command(np.array([0.5, 0.1]), np.array(8.0)),
    )
    memory = compiled_page.initial()
    for _ in range(3):
        step = compiled_page.step(memory, sensors, command)
        memory = step.memory
        action, targets, status = outputs(system, context)
        np.testing.assert_array_equal(action, memory[ACTION])
        np.testing.assert_array_equal(targets, step.targets)
        np.testing.assert_array_equal(targets, A1.joint_targets(action))
        assert status[0] == 0
        latch(system, context)
    assert np.any(memory[ACTION] != compiled_page.step(memory, sensors, command).memory[ACTION])


def test_contexts_remember_their_own(system, fix_inputs, latch, standing):
    context = fix_inputs(
        system, **sensed(standing), imu=AT_REST, command=[0.5, 0.0], commanded_dwell=8
    )
    clone = context.Clone()
    first, *_ = outputs(system, context)
    latch(system, context)
    assert np.any(outputs(system, context)[0] != first)
    np.testing.assert_array_equal(outputs(system, clone)[0], first)


def test_holds_the_target_where_a_sensor_is_not_finite(system, fix_inputs, latch, standing):
    context = fix_inputs(
        system, **sensed(standing), imu=AT_REST, command=[0.5, 0.0], commanded_dwell=8
    )
    before, *_ = outputs(system, context)
    latch(system, context)
    broken = sensed(standing)["joints"]
    broken[quadruped.N_JOINTS] = np.nan
    fix_inputs(system, context, joints=broken)
    action, _, status = outputs(system, context)
    assert status[0] == BAD_INPUT
    np.testing.assert_array_equal(action, before)


@pytest.fixture
def changing(compiled_pages) -> CompiledController:
    return CompiledController(compiled_pages)


@pytest.mark.parametrize("requested", [None, 0, 1])
def test_changes_the_gait_that_is_requested(
    requested, changing, compiled_pages, fix_inputs, latch, standing
):
    context = fix_inputs(
        changing, **sensed(standing), imu=AT_REST, command=[0.3, 0.0], commanded_dwell=6
    )
    if requested is not None:
        fix_inputs(changing, context, requested_gait=requested)
    # Standing on all feet ends no state: a gait that is not left by then has lost its rhythm.
    for _ in range(13):
        latch(changing, context)
    memory = context.get_discrete_state(0).value()
    assert compiled_pages.gait_of(memory) == (requested or 0)


@pytest.mark.parametrize("number", [-1.0, 3.0, np.nan, np.inf, 1e300])
def test_holds_the_target_where_no_such_gait_is_requested(
    number, changing, fix_inputs, latch, standing
):
    inputs = {**sensed(standing), "imu": AT_REST, "command": [0.3, 0.0], "commanded_dwell": 8}
    context = fix_inputs(changing, **inputs, requested_gait=0)
    before, *_ = outputs(changing, context)
    latch(changing, context)
    fix_inputs(changing, context, requested_gait=number)
    action, _, status = outputs(changing, context)
    assert status[0] == BAD_INPUT
    np.testing.assert_array_equal(action, before)
