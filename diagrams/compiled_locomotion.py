"""The locomotion diagram, driven by a controller that was compiled from C."""

from dataclasses import replace

from pydrake.systems.framework import Diagram, DiagramBuilder

from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.scenario import Scenario
from glassgait.models.errors import InputError
from glassgait.models.export.binding import LoadedController
from glassgait.models.task.gait import Gait
from glassgait.systems.compiled_controller import CompiledController
from glassgait.systems.foot_sensor import FootSensor
from glassgait.systems.imu import ImuSensor
from glassgait.systems.joint_sensor import JointSensor


def MakeCompiledLocomotion(  # noqa: N802
    gait: Gait, scenario: Scenario, controller: LoadedController
) -> Diagram:
    """Builds what `MakeLocomotion` builds without a policy, and a compiled controller that acts.

    The controller has a reward machine and an estimator of its own. The diagram's machine, which
    rewards, reads the true heights of the feet.

    Args:
        gait: The gait.
        scenario: The world; without noise in its sensors.
        controller: The controller.

    Raises:
        InputError: if the scenario's sensors have noise, or the gait is not made for the command.
    """
    noise = scenario.sensor_noise, scenario.contact_flips, scenario.encoder_bias
    stuck = scenario.stuck_open or scenario.stuck_closed
    if any(noise) or stuck or scenario.imu.half_widths.any():
        raise InputError(
            f"{scenario.refused_as()}: its sensors have errors, which a compiled controller has no "
            "port for; give sensor_noise 0, contact_flips 0, encoder_bias 0, an imu without bias, "
            "and leave stuck_open and stuck_closed out"
        )
    builder = DiagramBuilder()
    robot, law = scenario.robot_of(), controller.joint_law
    scenario = replace(scenario, station=scenario.station.with_gains(robot, law))
    if scenario.limit_targets is None:
        scenario = replace(scenario, limit_targets=law.limited)
    locomotion = builder.AddSystem(MakeLocomotion(gait, scenario))
    acting = builder.AddNamedSystem("compiled_controller", CompiledController(controller))
    state = locomotion.GetOutputPort("state")
    joints = builder.AddNamedSystem("joint_sensor", JointSensor(noise_factor=0.0))
    builder.Connect(state, joints.get_state_input_port())
    builder.Connect(joints.get_joints_output_port(), acting.get_joints_input_port())
    feet = builder.AddNamedSystem("foot_sensor", FootSensor(robot, scenario.station.ground))
    builder.Connect(state, feet.get_state_input_port())
    builder.Connect(feet.get_touching_output_port(), acting.get_touching_input_port())
    for name in ("command", "commanded_dwell"):
        builder.Connect(locomotion.GetOutputPort(name), acting.GetInputPort(name))
    if controller.has_imu:
        imu = builder.AddNamedSystem(
            "imu", ImuSensor(scenario.station.terrain.gravity, scenario.imu.delay, noise_factor=0.0)
        )
        builder.Connect(state, imu.get_state_input_port())
        builder.Connect(imu.get_imu_output_port(), acting.GetInputPort("imu"))
    builder.Connect(acting.get_action_output_port(), locomotion.GetInputPort("actions"))
    builder.ExportOutput(acting.get_targets_output_port(), "targets")
    builder.ExportOutput(acting.get_status_output_port(), "status")
    diagram = builder.Build()
    diagram.set_name("CompiledLocomotion")
    return diagram
