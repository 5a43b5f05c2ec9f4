"""The IMU: its readings, their errors, and Drake's own sensors beside it."""

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource
from pydrake.systems.sensors import Accelerometer, Gyroscope

from glassgait.diagrams.station import AddStation, StationConfig, actuated_joints
from glassgait.models.estimation.imu import GRAVITY, IMU_NOISE, ImuReading, measure_imu
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.terrain import Terrain
from glassgait.systems.imu import ImuSensor
from glassgait.systems.joint_targets import JointTargets

A1 = load_robot()
DOWN = np.array([0.0, 0.0, -GRAVITY])
AT_REST = [0, 0, 0, 0, 0, CONTROL_PERIOD * GRAVITY, 0, 0, -1]


def read(system, context):
    return system.get_imu_output_port().Eval(context)


def test_errors_of_a_shorter_period_have_their_share(standing, fix_inputs):
    system = ImuSensor(DOWN, period=CONTROL_PERIOD / 10)
    context = fix_inputs(system, state=standing, uniform_noise=np.ones(9), imu_bias=np.ones(9))
    share = np.repeat([1.0, 0.1, 1.0], 3)
    at_rest = [0, 0, 0, 0, 0, 0.1 * CONTROL_PERIOD * GRAVITY, 0, 0, -1]
    np.testing.assert_allclose(
        read(system, context), at_rest + share * (1.0 + IMU_NOISE), atol=1e-12
    )


def test_a_period_of_nothing_is_refused():
    with pytest.raises(ValueError, match="period is 0"):
        ImuSensor(DOWN, period=0.0)


def moving(standing, speed):
    state = standing.copy()
    state[quadruped.LINEAR_VELOCITY] = [speed, 0.0, 0.0]
    return state


def test_the_first_reading_is_of_a_robot_that_keeps_its_velocity(standing, fix_inputs):
    system = ImuSensor(DOWN)
    context = fix_inputs(system, state=moving(standing, 0.7))
    np.testing.assert_allclose(read(system, context), AT_REST, atol=1e-15)


def test_then_it_reads_the_change_since_the_control_instant_before(
    standing, random_states, fix_inputs, latch
):
    system = ImuSensor(DOWN)
    state, after = random_states(2)
    context = fix_inputs(system, state=state)
    latch(system, context)
    fix_inputs(system, context, state=after)
    expected = measure_imu(after, state[quadruped.LINEAR_VELOCITY], DOWN)
    np.testing.assert_array_equal(read(system, context), expected)


def test_readings_are_late_by_their_delay(standing, fix_inputs, latch):
    delay = 3
    late, prompt = ImuSensor(DOWN, delay), ImuSensor(DOWN)
    contexts = [fix_inputs(own, state=standing) for own in (late, prompt)]
    due, came = [], []
    for step in range(10):
        for system, context in zip((late, prompt), contexts, strict=True):
            fix_inputs(system, context, state=moving(standing, 0.1 * step**2))
        due.append(read(prompt, contexts[1]))
        came.append(read(late, contexts[0]))
        for system, context in zip((late, prompt), contexts, strict=True):
            latch(system, context)
    np.testing.assert_array_equal(came, [due[0]] * delay + due[:-delay])


def test_noise_and_bias_are_added(standing, fix_inputs):
    bias = np.arange(9.0)
    for factor in (0.0, 2.0):
        system = ImuSensor(DOWN, noise_factor=factor)
        context = fix_inputs(system, state=standing, uniform_noise=np.ones(9), imu_bias=bias)
        np.testing.assert_allclose(read(system, context), AT_REST + factor * IMU_NOISE + bias)
        fix_inputs(system, context, uniform_noise=np.full(9, 0.5), imu_bias=np.zeros(9))
        np.testing.assert_allclose(read(system, context), AT_REST, atol=1e-15)


def test_clones_keep_their_own_memory(standing, fix_inputs, latch):
    system = ImuSensor(DOWN, delay=1)
    context = fix_inputs(system, state=standing)
    clone = context.Clone()
    latch(system, context)
    for own in (context, clone):
        fix_inputs(system, own, state=moving(standing, 0.5))
    latch(system, context)
    assert ImuReading.of(read(system, context)).velocity_change[0] == pytest.approx(0.5)
    assert ImuReading.of(read(system, clone)).velocity_change[0] == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("setting", "message"),
    [({"delay": -1}, "delay"), ({"noise_factor": -1.0}, "noise_factor")]
    + [({"noise_factor": value}, "noise_factor") for value in (float("nan"), float("inf"))],
)
def test_refuses_errors_that_cannot_be(setting, message):
    with pytest.raises(ValueError, match=message):
        ImuSensor(DOWN, **setting)


def falling_robot(config):
    """A robot that is dropped and holds its pose, with Drake's sensors in its trunk's frame."""
    builder = DiagramBuilder()
    plant, _, instance = AddStation(builder, A1, config)
    targets = builder.AddSystem(JointTargets(A1, actuated_joints(plant)))
    action = builder.AddSystem(ConstantVectorSource(np.zeros(12)))
    builder.Connect(action.get_output_port(), targets.get_action_input_port())
    builder.Connect(
        targets.get_desired_state_output_port(), plant.get_desired_state_input_port(instance)
    )
    trunk, gravity = plant.GetBodyByName("trunk"), plant.gravity_field().gravity_vector()
    gyroscope = builder.AddSystem(Gyroscope(trunk, RigidTransform()))
    accelerometer = builder.AddSystem(Accelerometer(trunk, RigidTransform(), gravity))
    for sensor in (gyroscope, accelerometer):
        for index in range(sensor.num_input_ports()):
            port = sensor.get_input_port(index)
            builder.Connect(plant.GetOutputPort(port.get_name()), port)
    builder.ExportOutput(plant.get_state_output_port(), "state")
    builder.ExportOutput(gyroscope.get_output_port(), "gyroscope")
    builder.ExportOutput(accelerometer.get_output_port(), "accelerometer")
    return builder.Build()


@pytest.mark.parametrize("slope", [0.0, 10.0])
def test_drakes_sensors_read_the_same(slope, standing):
    step = 1e-4
    config = StationConfig(time_step=step, contact_solver="similar", terrain=Terrain(slope=slope))
    diagram = falling_robot(config)
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    plant = diagram.GetSubsystemByName("plant")
    standing[quadruped.POSITION][2] += 0.03
    standing[quadruped.ANGULAR_VELOCITY] = [1.0, -0.6, 0.4]
    standing[quadruped.LINEAR_VELOCITY] = [0.5, 0.2, -0.3]
    plant.SetPositionsAndVelocities(plant.GetMyMutableContextFromRoot(context), standing)
    simulator.Initialize()
    before, summed, struck = standing, np.zeros(3), False
    for part in range(1, 1001):
        # Drake's acceleration is that of the plant's next step, in the trunk's frame of now.
        state = diagram.GetOutputPort("state").Eval(context)
        own = diagram.GetOutputPort("accelerometer").Eval(context)
        summed += step * kinematics.rotation_matrix(state[quadruped.QUATERNION]) @ own
        simulator.AdvanceTo(part * step)
        if part % 200 == 0:
            state = diagram.GetOutputPort("state").Eval(context).copy()
            reading = measure_imu(state, before[quadruped.LINEAR_VELOCITY], config.terrain.gravity)
            ours = ImuReading.of(reading)
            gyroscope = diagram.GetOutputPort("gyroscope").Eval(context)
            np.testing.assert_allclose(ours.angular_velocity, gyroscope, atol=1e-12)
            change = kinematics.rotation_matrix(state[quadruped.QUATERNION]).T @ summed
            np.testing.assert_allclose(ours.velocity_change, change, atol=1e-9)
            struck |= change[2] > 1.5 * CONTROL_PERIOD * GRAVITY
            before, summed = state, np.zeros(3)
    assert struck
