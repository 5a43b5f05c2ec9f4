"""What judges a robot: its reward, and whether it has failed."""

import numpy as np
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import ConstantVectorSource

from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.sensed_robot import SensedRobot
from glassgait.models.robots import quadruped
from glassgait.models.robots.joint_law import JointLaw
from glassgait.systems.action_hold import ActionHold
from glassgait.systems.fall_monitor import FallMonitor
from glassgait.systems.reward import RewardSystem
from glassgait.systems.reward_machine import RewardMachineSystem


def AddJudges(  # noqa: N802
    builder: DiagramBuilder,
    sensed_robot: SensedRobot,
    scenario: Scenario,
    command: OutputPort,
    machine: RewardMachineSystem,
    hold: ActionHold,
    joint_law: JointLaw,
) -> dict[str, OutputPort]:
    """Adds the reward and what watches for failures.

    Args:
        builder: Where they are added.
        sensed_robot: The robot.
        scenario: Weights of the reward, and limits beyond which the robot has failed.
        command: Forward speed and yaw rate by which it goes (2; m/s, rad/s).
        machine: The gait's reward machine.
        hold: Holds the actions.
        joint_law: How joints follow them.

    Returns:
        `reward` (1), `plain_reward` (1), `reward_terms` (13) and `failures` (7).
    """
    reward = RewardSystem(sensed_robot.robot, scenario.weights, joint_law=joint_law)
    builder.AddNamedSystem("reward", reward)
    held, previous = hold.get_held_action_output_port(), hold.get_previous_action_output_port()
    failures = AddFallMonitor(builder, sensed_robot, scenario, actions=(held, previous))
    feet, connect = sensed_robot.sensors.feet, builder.Connect
    connect(sensed_robot.state, reward.get_state_input_port())
    connect(held, reward.get_action_input_port())
    connect(previous, reward.get_previous_action_input_port())
    connect(command, reward.get_command_input_port())
    connect(feet.get_foot_contact_output_port(), reward.get_foot_contact_input_port())
    connect(feet.get_foot_height_output_port(), reward.get_foot_height_input_port())
    connect(machine.get_reward_multiplier_output_port(), reward.get_reward_multiplier_input_port())
    return {
        "reward": reward.get_reward_output_port(),
        "plain_reward": reward.get_plain_reward_output_port(),
        "reward_terms": reward.get_reward_terms_output_port(),
        "failures": failures,
    }


def AddFallMonitor(  # noqa: N802
    builder: DiagramBuilder,
    sensed_robot: SensedRobot,
    scenario: Scenario,
    *,
    actions: tuple[OutputPort, OutputPort] | None = None,
) -> OutputPort:
    """Adds what watches for failures.

    Args:
        builder: Where it is added.
        sensed_robot: The robot.
        scenario: Limits beyond which it has failed.
        actions: The held action (12) and the one before it (12); where they are left out, no
            `abrupt_action` shows.

    Returns:
        The failures (7).
    """
    monitor = builder.AddNamedSystem(
        "fall_monitor", FallMonitor(sensed_robot.robot, scenario.limits, scenario.station.ground)
    )
    if actions is None:
        still = ConstantVectorSource(np.zeros(quadruped.N_JOINTS))
        no_action = builder.AddNamedSystem("no_action", still).get_output_port()
        actions = no_action, no_action
    held, previous = actions
    builder.Connect(sensed_robot.state, monitor.get_state_input_port())
    builder.Connect(held, monitor.get_action_input_port())
    builder.Connect(previous, monitor.get_previous_action_input_port())
    return monitor.get_failures_output_port()
