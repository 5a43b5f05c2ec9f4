"""Sensors, their errors, and Drake's sensors beside the IMU."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource
from pydrake.systems.sensors import Accelerometer, Gyroscope

from glassgait.diagrams.station import AddStation, StationConfig, actuated_joints
from glassgait.models import GRAVITY
from glassgait.models.estimation.sensors import (
    IMU_NOISE,
    ImuErrors,
    ImuReading,
    measure_imu,
    stuck_sensors,
)
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.observation import JOINT_NOISE
from glassgait.models.task.randomization import NOMINAL
from glassgait.models.task.terrain import Terrain
from glassgait.systems.action import JointTargets
from glassgait.systems.sensors import ContactSensor, FootSensor, ImuSensor, JointSensor, SensorBias

A1 = load_robot()
DOWN = np.array([0.0, 0.0, -GRAVITY])
AT_REST = [0, 0, 0, 0, 0, CONTROL_PERIOD * GRAVITY, 0, 0, -1]
BIASED = ImuErrors(gyroscope_bias=0.1, accelerometer_bias=0.5)


def moved(standing, *, lift=0.0, speed=0.0):
    state = standing.copy()
    state[6] += lift
    state[quadruped.LINEAR_VELOCITY] = [speed, 0.0, 0.0]
    return state


def test_joints_are_measured_with_scaled_noise_and_bias(random_states, fix_inputs):
    (state,) = random_states(1)
    true = np.concatenate([state[quadruped.JOINT_POSITION], state[quadruped.JOINT_VELOCITY]])
    bias = np.linspace(-0.02, 0.02, 12)
    for factor in (0.0, 1.0, 2.0):
        system = JointSensor(factor)
        context = fix_inputs(system, state=state)
        np.testing.assert_array_equal(system.get_output_port().Eval(context), true)
        fix_inputs(system, context, uniform_noise=np.ones(24), encoder_bias=bias)
        error = factor * JOINT_NOISE + np.concatenate([bias, np.zeros(12)])
        found = system.get_output_port().Eval(context)
        np.testing.assert_allclose(found - true, error, atol=1e-15)


def test_feet_touch_now_and_contacts_last_a_control_step(standing, fix_inputs, latch):
    system = FootSensor(A1)
    pressed, lifted = moved(standing, lift=-0.012), moved(standing, lift=0.05)
    contact, touching = (system.GetOutputPort(name) for name in ("foot_contact", "touching"))
    context = fix_inputs(system, state=pressed)
    np.testing.assert_array_equal(touching.Eval(context), 1)
    latch(system, context)
    fix_inputs(system, context, state=lifted)
    np.testing.assert_array_equal(touching.Eval(context), 0)
    np.testing.assert_array_equal(contact.Eval(context), 1)
    np.testing.assert_allclose(system.GetOutputPort("foot_height").Eval(context).min(), 0.05)
    latch(system, context)
    np.testing.assert_array_equal(contact.Eval(context), 0)


def test_contact_sensors_flip_and_stick(fix_inputs):
    system = ContactSensor(0.1)
    context = fix_inputs(system, touching=[1, 1, 0, 0], uniform_noise=[0.05, 0.1, 0.09, 0.5])
    np.testing.assert_array_equal(system.get_output_port().Eval(context), [0, 1, 1, 0])
    system = ContactSensor(0.5, stuck_sensors(("FL",), ("RR",)))
    for touching in (0, 1):
        context = fix_inputs(system, touching=4 * [touching])
        found = system.get_output_port().Eval(context).tolist()
        assert found == [0, touching, touching, 1]
        flipped = fix_inputs(system, context, uniform_noise=np.zeros(4))
        found = system.get_output_port().Eval(flipped).tolist()
        assert found == [0, 1 - touching, 1 - touching, 1]


def test_biases_are_the_seeds_and_hold(fix_inputs):
    system = SensorBias(replace(NOMINAL, encoder_bias=0.02, imu=BIASED))
    ports = [system.GetOutputPort(name) for name in ("encoder_bias", "imu_bias")]
    draws = []
    for seed in range(200):
        context = fix_inputs(system, seed=seed)
        draws.append(np.concatenate([port.Eval(context) for port in ports]))
        context.SetTime(123.0)
        np.testing.assert_array_equal(ports[0].Eval(context), draws[-1][:12])
    greatest = np.abs(draws).max(axis=0)
    assert 0.019 < greatest[:12].max() <= 0.02
    np.testing.assert_allclose(greatest[12:], BIASED.half_widths, rtol=0.05)
    none = SensorBias(NOMINAL)
    assert not none.GetOutputPort("imu_bias").Eval(fix_inputs(none, seed=1.0)).any()


def test_the_imu_reads_the_change_since_the_control_instant_before(
    standing, random_states, fix_inputs, latch
):
    system = ImuSensor(DOWN)
    # At first the robot seems to have kept its velocity.
    context = fix_inputs(system, state=moved(standing, speed=0.7))
    np.testing.assert_allclose(system.get_output_port().Eval(context), AT_REST, atol=1e-15)
    state, after = random_states(2)
    fix_inputs(system, context, state=state)
    latch(system, context)
    fix_inputs(system, context, state=after)
    expected = measure_imu(after, state[quadruped.LINEAR_VELOCITY], DOWN)
    np.testing.assert_array_equal(system.get_output_port().Eval(context), expected)


def test_readings_of_the_imu_are_late_by_their_delay(standing, fix_inputs, latch):
    delay, came = 3, {}
    for late in (0, delay):
        system = ImuSensor(DOWN, late)
        context, came[late] = system.CreateDefaultContext(), []
        for step in range(10):
            fix_inputs(system, context, state=moved(standing, speed=0.1 * step**2))
            came[late].append(system.get_output_port().Eval(context).copy())
            latch(system, context)
    np.testing.assert_array_equal(came[delay], [came[0][0]] * delay + came[0][:-delay])


def test_noise_and_bias_are_added_to_the_imu(standing, fix_inputs):
    bias = np.arange(9.0)
    for factor in (0.0, 2.0):
        system = ImuSensor(DOWN, noise_factor=factor)
        context = fix_inputs(system, state=standing, uniform_noise=np.ones(9), imu_bias=bias)
        found = system.get_output_port().Eval(context)
        np.testing.assert_allclose(found, AT_REST + factor * IMU_NOISE + bias)


def falling_robot(config):
    """A robot that is dropped and holds its pose, with Drake's sensors in its trunk's frame."""
    builder = DiagramBuilder()
    plant, _, instance = AddStation(builder, A1, config)
    targets = builder.AddSystem(JointTargets(A1, actuated_joints(plant)))
    action = builder.AddSystem(ConstantVectorSource(np.zeros(12)))
    builder.Connect(action.get_output_port(), targets.get_input_port())
    builder.Connect(targets.get_output_port(), plant.get_desired_state_input_port(instance))
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
        found = diagram.GetOutputPort("accelerometer").Eval(context)
        summed += step * kinematics.rotation_matrix(state[quadruped.QUATERNION]) @ found
        simulator.AdvanceTo(part * step)
        if part % 200 == 0:
            state = diagram.GetOutputPort("state").Eval(context).copy()
            reading = measure_imu(state, before[quadruped.LINEAR_VELOCITY], config.terrain.gravity)
            ours = ImuReading.of(reading)
            gyroscope = diagram.GetOutputPort("gyroscope").Eval(context)
            np.testing.assert_allclose(ours.angular_velocity, gyroscope, atol=1e-12)
            to_trunk = kinematics.rotation_matrix(state[quadruped.QUATERNION]).T
            change, down = to_trunk @ summed, config.terrain.gravity / GRAVITY
            np.testing.assert_allclose(ours.gravity, to_trunk @ down, atol=1e-12)
            np.testing.assert_allclose(ours.velocity_change, change, atol=1e-9)
            struck |= change[2] > 1.5 * CONTROL_PERIOD * GRAVITY
            before, summed = state, np.zeros(3)
    assert struck
