"""Wires a shipped policy into a diagram of one's own, without the loop that this project builds.

    python -m glassgait.studies.examples.policy_in_own_diagram

Two linear laws trot, one for each state of the reward machine, as expressions of Drake's symbols.
They observe the true velocity and heights of the feet, which no sensor of the robot measures, and
which not every policy bears. It prints how far the robot comes.
"""

from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, Multiplexer

from glassgait.diagrams.station import AddStation, StationConfig, actuated_joints
from glassgait.models.policies.library import load_student
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.gait import load_gait
from glassgait.models.task.observation import N_ESTIMATED
from glassgait.systems.control import (
    ActionHold,
    JointTargets,
    Proprioception,
    RewardMachineSystem,
    TargetLimitsSystem,
)
from glassgait.systems.sensors import BodyStateSensor, FootSensor, ImuSensor, JointSensor
from glassgait.systems.symbolic_policy import make_symbolic_policy


def make_diagram() -> Diagram:
    """Connects the robot, what it senses, the policy and the joints."""
    robot, gait, builder = load_robot(), load_gait("trot"), DiagramBuilder()
    student = load_student("trot", "statewise_linear")
    law, layout = student.joint_law, student.layout
    plant, _, instance = AddStation(builder, robot, StationConfig().with_gains(robot, law))
    command = builder.AddSystem(ConstantVectorSource([0.5, 0.0]))  # m/s, rad/s
    dwell = builder.AddSystem(ConstantVectorSource([8.0]))  # control steps in a state
    feet = builder.AddSystem(FootSensor(robot))
    machine = builder.AddSystem(RewardMachineSystem(gait))
    joints = builder.AddSystem(JointSensor())
    imu = builder.AddSystem(ImuSensor(plant.gravity_field().gravity_vector()))
    sensed = builder.AddSystem(Proprioception(robot, layout, limited=law.limited))
    body = builder.AddSystem(BodyStateSensor(robot))
    observation = builder.AddSystem(Multiplexer([layout.n_proprioceptive, N_ESTIMATED]))
    policy = builder.AddSystem(make_symbolic_policy(student))
    limits = builder.AddSystem(TargetLimitsSystem(robot, law.limits))
    hold = builder.AddSystem(ActionHold())
    targets = builder.AddSystem(JointTargets(robot, actuated_joints(plant), limited=law.limited))

    for system in (feet, joints, imu, body):
        builder.Connect(plant.get_state_output_port(), system.GetInputPort("state"))
    for source, target, ports in [
        (feet, machine, ("foot_contact", "foot_height")),
        (machine, sensed, ("rm_state", "rm_iterations")),
    ]:
        for port in ports:
            builder.Connect(source.GetOutputPort(port), target.GetInputPort(port))
    for system in (sensed, limits):
        builder.Connect(joints.get_output_port(), system.GetInputPort("joints"))
        builder.Connect(imu.get_output_port(), system.GetInputPort("imu"))
        builder.Connect(hold.GetOutputPort("held_action"), system.GetInputPort("previous_action"))
    for system in (machine, sensed):
        builder.Connect(dwell.get_output_port(), system.GetInputPort("commanded_dwell"))
    builder.Connect(command.get_output_port(), sensed.GetInputPort("command"))
    builder.Connect(sensed.get_output_port(), observation.get_input_port(0))
    builder.Connect(body.get_output_port(), observation.get_input_port(1))
    builder.Connect(observation.get_output_port(), policy.get_input_port())
    builder.Connect(policy.get_output_port(), limits.GetInputPort("action"))
    builder.Connect(limits.get_output_port(), hold.get_input_port())
    builder.Connect(hold.GetOutputPort("held_action"), targets.GetInputPort("action"))
    builder.Connect(targets.get_output_port(), plant.get_desired_state_input_port(instance))
    builder.ExportOutput(plant.get_state_output_port(), "state")
    return builder.Build()


def main() -> None:
    """Lets the robot trot for 5 s."""
    diagram = make_diagram()
    simulator = Simulator(diagram)
    simulator.AdvanceTo(5.0)
    x, y, height = diagram.GetOutputPort("state").Eval(simulator.get_context())[quadruped.POSITION]
    print(
        f"after 5 s at a command of 0.5 m/s: {x:.2f} m ahead, {y:+.2f} m aside, {height:.2f} m high"
    )


if __name__ == "__main__":
    main()
