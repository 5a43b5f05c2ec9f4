"""A robot's sensors: joints, feet and IMU, with what is wrong with their readings."""

from dataclasses import dataclass

from pydrake.common import RandomDistribution
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import RandomSource

from glassgait.diagrams.commands import AddSeed
from glassgait.diagrams.scenario import Scenario
from glassgait.models.estimation.contact import stuck_sensors
from glassgait.models.estimation.imu import N_IMU
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.systems.contact_sensor import ContactSensor
from glassgait.systems.foot_sensor import FootSensor
from glassgait.systems.imu import ImuSensor
from glassgait.systems.joint_sensor import JointSensor
from glassgait.systems.sensor_bias import SensorBias


@dataclass(frozen=True)
class SensorErrors:
    """Where the errors of sensors come from; None where they have none.

    Attributes:
        joint_noise: Noise of the joints' sensors (24, in [0, 1]).
        contact_noise: Noise of the feet's contact sensors (4, in [0, 1]).
        imu_noise: Noise of the IMU (9, in [0, 1]).
        bias: Draws constant errors.
    """

    joint_noise: OutputPort | None
    contact_noise: OutputPort | None
    imu_noise: OutputPort | None
    bias: SensorBias | None


@dataclass(frozen=True)
class Sensors:
    """What sensors measure.

    Attributes:
        joints: Joint positions, then velocities (24; rad, rad/s).
        touching: Which feet seem to touch at this instant (4).
        imu: The IMU's reading (9); None without an IMU.
        feet: What senses the feet without errors.
    """

    joints: OutputPort
    touching: OutputPort
    imu: OutputPort | None
    feet: FootSensor


def AddSensorErrors(  # noqa: N802
    builder: DiagramBuilder, scenario: Scenario, *, imu: bool
) -> SensorErrors:
    """Adds the sources of a scenario's sensor errors.

    What was added first draws first in a random context: noise of joints and feet is the same with
    an IMU and without.
    """
    noise = scenario.sensor_noise
    return SensorErrors(
        joint_noise=_add_noise(builder, "sensor_noise", noise, 2 * quadruped.N_JOINTS),
        contact_noise=_add_noise(
            builder, "contact_noise", scenario.contact_flips, quadruped.N_LEGS
        ),
        imu_noise=_add_noise(builder, "imu_noise", noise, N_IMU) if imu else None,
        bias=_add_bias(builder, scenario, imu),
    )


def AddSensors(  # noqa: N802
    builder: DiagramBuilder,
    robot: Robot,
    scenario: Scenario,
    state: OutputPort,
    errors: SensorErrors,
    *,
    imu: bool,
    imu_period: float = CONTROL_PERIOD,
) -> Sensors:
    """Adds the sensors of a robot whose plant's state (37) is given.

    Args:
        builder: Where they are added.
        robot: The robot.
        scenario: What is wrong with them.
        state: The plant's state (37).
        errors: Where their errors come from.
        imu: Whether there is an IMU.
        imu_period: Time from one of its readings to the next (s).
    """
    joints = builder.AddNamedSystem("joint_sensor", JointSensor(scenario.sensor_noise))
    builder.Connect(state, joints.get_state_input_port())
    if errors.joint_noise is not None:
        builder.Connect(errors.joint_noise, joints.get_uniform_noise_input_port())
    if errors.bias is not None:
        bias = errors.bias.get_encoder_bias_output_port()
        builder.Connect(bias, joints.get_encoder_bias_input_port())
    feet = builder.AddNamedSystem("foot_sensor", FootSensor(robot, scenario.station.ground))
    builder.Connect(state, feet.get_state_input_port())
    touching = _misread(builder, scenario, errors, feet.get_touching_output_port())
    reading = _add_imu(builder, scenario, state, errors, imu_period) if imu else None
    return Sensors(joints.get_joints_output_port(), touching, reading, feet)


def _add_noise(builder: DiagramBuilder, name: str, share: float, size: int) -> OutputPort | None:
    """Adds a source of numbers from 0 to 1, new ones every control step; None where share is 0."""
    if share == 0:
        return None
    noise = RandomSource(RandomDistribution.kUniform, size, CONTROL_PERIOD)
    return builder.AddNamedSystem(name, noise).get_output_port()


def _add_bias(builder: DiagramBuilder, scenario: Scenario, imu: bool) -> SensorBias | None:
    if scenario.encoder_bias == 0 and not (imu and scenario.imu.half_widths.any()):
        return None
    bias = builder.AddNamedSystem("sensor_bias", SensorBias(scenario.randomization()))
    builder.Connect(AddSeed(builder, "sensor_bias_seed"), bias.get_seed_input_port())
    return bias


def _misread(
    builder: DiagramBuilder, scenario: Scenario, errors: SensorErrors, touching: OutputPort
) -> OutputPort:
    """Returns which feet touch as sensors read it."""
    stuck = stuck_sensors(scenario.stuck_open, scenario.stuck_closed)
    if errors.contact_noise is None and not stuck.any():
        return touching
    sensors = ContactSensor(scenario.contact_flips, stuck)
    builder.AddNamedSystem("contact_sensors", sensors)
    builder.Connect(touching, sensors.get_touching_input_port())
    if errors.contact_noise is not None:
        builder.Connect(errors.contact_noise, sensors.get_uniform_noise_input_port())
    return sensors.get_sensed_contact_output_port()


def _add_imu(
    builder: DiagramBuilder,
    scenario: Scenario,
    state: OutputPort,
    errors: SensorErrors,
    period: float,
) -> OutputPort:
    delay = round(scenario.imu.delay * CONTROL_PERIOD / period)
    gravity = scenario.station.terrain.gravity
    sensor = ImuSensor(gravity, delay, scenario.sensor_noise, period)
    builder.AddNamedSystem("imu", sensor)
    builder.Connect(state, sensor.get_state_input_port())
    if errors.imu_noise is not None:
        builder.Connect(errors.imu_noise, sensor.get_uniform_noise_input_port())
    if errors.bias is not None:
        bias = errors.bias.get_imu_bias_output_port()
        builder.Connect(bias, sensor.get_imu_bias_input_port())
    return sensor.get_imu_output_port()
