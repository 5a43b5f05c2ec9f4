"""The self-test of the wiring: every change of it is noticed, and no sound robot is refused."""

from dataclasses import replace
from functools import cache
from itertools import combinations

import numpy as np
import pytest

from glassgait.diagrams.self_test import measure_self_test, predict_self_test
from glassgait.models.link.self_test import (
    N_STEPS,
    REST_STEPS,
    exchange,
    motion_findings,
    rest_findings,
    self_test_targets,
)
from glassgait.models.robots.library import load_robot, robot_names
from glassgait.models.robots.quadruped import JOINTS, LEGS, N_JOINTS
from glassgait.models.task.imu import IMU_NOISE
from glassgait.studies.training.robot_command import STATIONS

DRAKE, MUJOCO = STATIONS
DEGREES = 180.0 / np.pi

robots = pytest.mark.parametrize("name", robot_names())
OTHERS = sorted({*robot_names()} - {"a1"})


@cache
def predicted(name):
    return predict_self_test(load_robot(name), MUJOCO)


@cache
def measured(name, station=DRAKE):
    """What a robot measures whose targets are changed by each of several functions."""
    robot = load_robot(name)
    return measure_self_test(robot, station, self_test_targets(robot)[None])[0]


def noisy(trace, generator):
    """Adds the noise of sensors, constant errors of encoders, and a delay."""
    late = int(generator.integers(0, 3))
    trace = type(trace)(*(np.concatenate([own[:1]] * late + [own])[:N_STEPS] for own in trace))

    def drawn(shape, width):
        return width * generator.uniform(-1.0, 1.0, shape)

    position = trace.joint_position + drawn((N_STEPS, N_JOINTS), 0.01) + drawn(N_JOINTS, 0.02)
    velocity = trace.joint_velocity + drawn((N_STEPS, N_JOINTS), 1.5)
    imu = trace.imu + drawn((N_STEPS, 9), IMU_NOISE)
    return trace._replace(joint_position=position, joint_velocity=velocity, imu=imu)


def findings(name, trace):
    prediction = predicted(name)
    return rest_findings(prediction.expected, trace) + motion_findings(prediction, trace)


def sensors(trace, change):
    """Changes joint positions and velocities alike."""
    return trace._replace(
        joint_position=change(trace.joint_position), joint_velocity=change(trace.joint_velocity)
    )


@robots
def test_moves_keep_within_the_joints_ranges_and_begin_and_end_at_rest(name):
    robot = load_robot(name)
    targets = self_test_targets(robot)
    assert targets.shape == (N_STEPS, N_JOINTS) and N_STEPS == 100
    assert np.all((targets >= robot.lower_limits) & (targets <= robot.upper_limits))
    np.testing.assert_array_equal(targets[:REST_STEPS], np.tile(robot.default_stance, (4, 1)))
    np.testing.assert_array_equal(targets[-1], robot.default_stance)
    assert np.all(np.ptp(targets, axis=0) > 0.2)


@robots
@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 3))]
)
def test_a_sound_robot_passes_in_either_engine_loaded_weak_and_slippery(name, seed):
    generator = np.random.default_rng(seed)
    station = replace(
        STATIONS[seed % 2],
        payload=generator.uniform(0.0, 2.0),
        payload_position=tuple(generator.uniform(-0.08, 0.08, 3)),
        motor_strength=generator.uniform(0.8, 1.2),
        friction=generator.uniform(0.4, 1.25),
        armature=generator.uniform(0.0, 0.01),
    )
    assert findings(name, noisy(measured(name, station), generator)) == []


SENSORS = {
    f"{what} of {JOINTS[i]} and {JOINTS[j]}": (fields, exchange((i, j)))
    for what, fields in (
        ("positions", ("joint_position",)),
        ("velocities", ("joint_velocity",)),
        ("sensors", ("joint_position", "joint_velocity")),
    )
    for i, j in combinations(range(N_JOINTS), 2)
}


@pytest.mark.slow
@robots
def test_every_exchange_of_two_joints_sensors_is_noticed(name, generator):
    clean = measured(name)
    missed = [
        what
        for what, (fields, order) in SENSORS.items()
        if not findings(
            name,
            noisy(
                clean._replace(**{own: getattr(clean, own)[:, order] for own in fields}), generator
            ),
        )
    ]
    assert missed == []


@pytest.mark.slow
@robots
def test_every_exchange_of_two_joints_targets_is_noticed_with_that_of_their_sensors_too(
    name, generator
):
    robot, pairs = load_robot(name), list(combinations(range(N_JOINTS), 2))
    targets = np.stack([self_test_targets(robot)[:, exchange(pair)] for pair in pairs])
    missed = []
    for pair, moved in zip(pairs, measure_self_test(robot, DRAKE, targets), strict=True):
        order = exchange(pair)
        both = sensors(moved, lambda own, order=order: own[:, order])
        for what, trace in (("targets", moved), ("both", both)):
            if not findings(name, noisy(trace, generator)):
                missed.append((what, *(JOINTS[joint] for joint in pair)))
    assert missed == []


@pytest.mark.parametrize(
    "name", ["a1", *(pytest.param(own, marks=pytest.mark.slow) for own in OTHERS)]
)
def test_every_sign_and_unit_of_joints_is_noticed(name, generator):
    robot, clean = load_robot(name), measured(name)
    factors = {
        f"sign of {joint}": np.where(np.arange(12) == i, -1.0, 1.0)
        for i, joint in enumerate(JOINTS)
    }
    factors |= {"degrees": np.full(12, DEGREES), "radians": np.full(12, 1.0 / DEGREES)}
    targets = np.stack([self_test_targets(robot) * factor for factor in factors.values()])
    missed = []
    moves = measure_self_test(robot, DRAKE, targets)
    for (what, factor), moved in zip(factors.items(), moves, strict=True):
        changed = {
            "position": clean._replace(joint_position=clean.joint_position * factor),
            "velocity": clean._replace(joint_velocity=clean.joint_velocity * factor),
            "targets": moved,
            "both": sensors(moved, lambda own, factor=factor: own / factor),
        }
        missed += [
            (what, own)
            for own, trace in changed.items()
            if not findings(name, noisy(trace, generator))
        ]
    assert missed == []


@robots
def test_every_axis_and_unit_of_the_imu_is_noticed(name, generator):
    clean = measured(name)
    changes = {f"sign of {i}": np.where(np.arange(9) == i, -1.0, 1.0) for i in range(9)}
    for factor in (DEGREES, 1.0 / DEGREES):
        changes[f"gyroscope {factor}"] = np.repeat([factor, 1.0, 1.0], 3)
    for factor in (9.81, 1.0 / 9.81, 50.0, 1.0 / 50.0):
        changes[f"accelerometer {factor}"] = np.repeat([1.0, factor, 1.0], 3)
        changes[f"gravity {factor}"] = np.repeat([1.0, 1.0, factor], 3)
    traces = {what: clean._replace(imu=clean.imu * factor) for what, factor in changes.items()}
    for part in range(3):
        for i, j in combinations(range(3), 2):
            order = np.arange(9)
            order[[3 * part + i, 3 * part + j]] = order[[3 * part + j, 3 * part + i]]
            traces[f"axes {order}"] = clean._replace(imu=clean.imu[:, order])
    missed = [what for what, own in traces.items() if not findings(name, noisy(own, generator))]
    assert missed == []


@robots
def test_contact_sensors_that_are_exchanged_or_inverted_are_noticed(name, generator):
    clean = measured(name)
    for i, j in combinations(range(len(LEGS)), 2):
        order = np.arange(len(LEGS))
        order[[i, j]] = order[[j, i]]
        found = findings(name, noisy(clean._replace(touching=clean.touching[:, order]), generator))
        assert any("contact sensors" in own for own in found)
    assert findings(name, clean._replace(touching=~clean.touching))
    for foot, leg in enumerate(LEGS):
        for stuck in (False, True):
            touching = clean.touching.copy()
            touching[:, foot] = stuck
            found = findings(name, noisy(clean._replace(touching=touching), generator))
            assert any(f"foot {leg}" in own for own in found)


@robots
@pytest.mark.parametrize("step", [5, 40, 70, 80, 90])
def test_sensors_that_freeze_are_noticed(name, step, generator):
    trace = noisy(measured(name), generator)
    frozen = type(trace)(
        *(
            np.concatenate([own[:step], np.repeat(own[step : step + 1], N_STEPS - step, 0)])
            for own in trace
        )
    )
    assert any("read the same" in own for own in findings(name, frozen))


@robots
def test_gains_in_other_units_and_silent_sensors_are_noticed(name, generator):
    for factor in (0.02, 0.1, 10.0):
        stiff = replace(DRAKE, stiffness=factor * load_robot(name).stiffness)
        assert findings(name, noisy(measured(name, stiff), generator))
    clean = measured(name)
    for field in ("joint_position", "joint_velocity", "imu"):
        for silent in (0.0, np.nan):
            assert findings(name, clean._replace(**{field: getattr(clean, field) * silent}))
