"""A robot on its ground with its sensors, whatever controls it."""

from dataclasses import dataclass

from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder, InputPort, OutputPort

from glassgait.diagrams.ground import laid
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.sensors import AddSensorErrors, AddSensors, Sensors
from glassgait.diagrams.station import AddStation, AddWorldState
from glassgait.models.robots.joint_law import OWN_LAW, JointLaw
from glassgait.models.robots.robot import Robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.terrain import Terrain


@dataclass(frozen=True)
class SensedRobot:
    """A robot on its ground, and what is sensed of it.

    Attributes:
        robot: The robot.
        terrain: The ground.
        plant: The plant.
        scene_graph: Its scene graph.
        instance: The robot's model instance in the plant.
        state: The robot's state (37), wherever it has gone to.
        sensors: What its sensors measure.
    """

    robot: Robot
    terrain: Terrain
    plant: MultibodyPlant
    scene_graph: SceneGraph
    instance: ModelInstanceIndex
    state: OutputPort
    sensors: Sensors

    @property
    def desired_state(self) -> InputPort:
        """Where joint positions, then velocities are desired (24; rad, rad/s)."""
        return self.plant.get_desired_state_input_port(self.instance)


def AddSensedRobot(  # noqa: N802
    builder: DiagramBuilder,
    robot: Robot,
    scenario: Scenario,
    *,
    imu: bool,
    joint_law: JointLaw = OWN_LAW,
    imu_period: float = CONTROL_PERIOD,
    sampled: bool = False,
) -> SensedRobot:
    """Adds a scenario's station and the robot's sensors, whose errors draw first.

    Args:
        builder: Where they are added. The plant stands in this diagram itself: the error-controlled
            contact integrator looks for it there.
        robot: The robot.
        scenario: Its station, and what is wrong with sensors.
        imu: Whether there is an IMU.
        joint_law: What gives the gains that the station leaves out.
        imu_period: Time from one of the IMU's readings to the next (s).
        sampled: Whether the plant puts out contacts and torques of the step before; see
            `AddStation`.

    Raises:
        InputError: if the station is not Drake's, or its ground is too high for the robot.
    """
    errors = AddSensorErrors(builder, scenario, imu=imu)
    station = scenario.station.with_gains(robot, joint_law)
    plant, scene_graph, instance = AddStation(
        builder, robot, station, reach=laid(station.terrain), sampled=sampled
    )
    state = AddWorldState(builder, plant, station)
    sensors = AddSensors(builder, robot, scenario, state, errors, imu=imu, imu_period=imu_period)
    return SensedRobot(robot, station.terrain, plant, scene_graph, instance, state, sensors)
