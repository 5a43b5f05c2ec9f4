"""A simulated robot behind Unitree's messages: the station, its motors and its sensors."""

from dataclasses import replace

from pydrake.geometry import GeometryId, Meshcat, SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import PdControllerGains
from pydrake.systems.framework import Diagram, DiagramBuilder

from glassgait.diagrams.judges import AddFallMonitor
from glassgait.diagrams.linked_robot import refuse_unfit
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.sensed_robot import AddSensedRobot
from glassgait.diagrams.visualization import AddRobotDisplay
from glassgait.models.arrays import Array
from glassgait.models.link.low_state import PERIOD, foot_force_of
from glassgait.models.robots import quadruped
from glassgait.models.robots.quadruped import LEGS
from glassgait.systems.foot_force_sensor import FootForceSensor


def MakeUnitreeRobot(scenario: Scenario, meshcat: Meshcat | None = None) -> Diagram:  # noqa: N802
    """Builds the station with motors that are driven one by one, and sensors every 2 ms.

    .. pydrake_system::

        name: UnitreeRobot
        input_ports:
        - desired_state
        - actuation
        output_ports:
        - state
        - joints
        - imu
        - foot_force
        - torque

    Inputs, in the order of the plant's actuators: desired_state (24; rad, rad/s), positions, then
    velocities. actuation (12; N·m), added to what the gains make of it; see `set_gains`.
    Outputs: state (37), the plant's. joints (24; rad, rad/s), measured positions, then velocities.
    imu (9), the reading of the last 2 ms. Of the step before this instant: foot_force (4; N), FL FR
    RL RR, and torque (12; N·m), in the order of the actuators, as the motors' limits leave it.

    Args:
        scenario: The world; its plant's step is to be 2 ms.
        meshcat: Shows the robot there.

    Raises:
        InputError: if the scenario is not made for two processes, or the robot's file does not say
            how its feet's forces are read.
    """
    refuse_unfit(scenario)
    robot = scenario.robot_of()
    foot_force_of(robot)
    builder = DiagramBuilder()
    sensed_robot = AddSensedRobot(
        builder, robot, scenario, imu=True, imu_period=PERIOD, sampled=True
    )
    plant, instance = sensed_robot.plant, sensed_robot.instance
    feet = _feet(plant, sensed_robot.scene_graph)
    forces = builder.AddNamedSystem("foot_force_sensor", FootForceSensor(feet))
    builder.Connect(
        plant.get_contact_results_output_port(), forces.get_contact_results_input_port()
    )
    AddFallMonitor(builder, sensed_robot, scenario)
    if meshcat is not None:
        AddRobotDisplay(builder, sensed_robot, meshcat)
    builder.ExportInput(sensed_robot.desired_state, "desired_state")
    builder.ExportInput(plant.get_actuation_input_port(instance), "actuation")
    exported = {
        "state": sensed_robot.state,
        "joints": sensed_robot.sensors.joints,
        "imu": sensed_robot.sensors.imu,
        "foot_force": forces.get_foot_force_output_port(),
        "torque": plant.get_net_actuation_output_port(instance),
    }
    for name, port in exported.items():
        builder.ExportOutput(port, name)
    diagram = builder.Build()
    diagram.set_name("UnitreeRobot")
    return diagram


def at_its_rate(scenario: Scenario) -> Scenario:
    """Returns a scenario whose plant takes a step of 2 ms for every state that is sent."""
    return replace(scenario, station=replace(scenario.station, time_step=PERIOD))


def set_gains(plant: MultibodyPlant, kp: Array, kd: Array) -> None:
    """Sets the joints' gains (12; N·m/rad, N·m·s/rad), which Drake keeps in the plant itself.

    They hold from the plant's next step on.
    """
    for index in plant.GetJointActuatorIndices():
        actuator = plant.get_mutable_joint_actuator(index)
        joint = quadruped.JOINTS.index(actuator.joint().name())
        actuator.set_controller_gains(PdControllerGains(p=kp[joint], d=kd[joint]))


def _feet(plant: MultibodyPlant, scene_graph: SceneGraph) -> dict[GeometryId, int]:
    inspector = scene_graph.model_inspector()
    feet = {}
    for number, leg in enumerate(LEGS):
        calf = plant.GetBodyByName(f"{leg}_calf")
        for geometry in plant.GetCollisionGeometriesForBody(calf):
            if inspector.GetName(geometry).endswith(f"{leg}_foot"):
                feet[geometry] = number
    return feet
