"""The drop test: the standing robot falls 3 cm onto its feet. Do they stay where they land?"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator

from glassgait.diagrams.rollout import use_error_control
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.station import MakeStation, actuated_joints
from glassgait.models.arrays import Array
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.robot import Robot

DROP_HEIGHT = 0.03
"""Height of the feet above the ground at the start (m)."""

DURATION = 1.0
"""Simulated time (s)."""

SAMPLE_PERIOD = 0.01
"""Time between two samples (s)."""


@dataclass(frozen=True)
class Drop:
    """What the robot did.

    Attributes:
        stance: Distance between left and right feet in the end, mean of both pairs (m).
        height: Height of the trunk in the end (m).
        penetration: Greatest depth of a foot in the ground (m).
    """

    stance: float
    height: float
    penetration: float


def drop_robot(scenario: Scenario) -> Drop:
    """Drops the robot in its default stance, its joints held there."""
    robot = scenario.robot_of()
    station = MakeStation(robot, scenario.station)
    plant = station.GetSubsystemByName("plant")
    assert isinstance(plant, MultibodyPlant)
    simulator = Simulator(station)
    context = simulator.get_mutable_context()
    targets = [
        robot.default_stance[quadruped.JOINTS.index(name)] for name in actuated_joints(plant)
    ]
    desired = np.concatenate([targets, np.zeros(quadruped.N_JOINTS)])
    station.GetInputPort("desired_state").FixValue(context, desired)
    # Drake names arrays by scalar, which NumPy's own types do not match.
    state: Any = kinematics.standing_state(robot)
    state[quadruped.POSITION][2] += DROP_HEIGHT
    plant.SetPositionsAndVelocities(plant.GetMyMutableContextFromRoot(context), state)
    if scenario.accuracy is not None:
        use_error_control(simulator, scenario.accuracy)
    simulator.Initialize()
    port = station.GetOutputPort("state")
    states = []
    for time in np.arange(1, round(DURATION / SAMPLE_PERIOD) + 1) * SAMPLE_PERIOD:
        simulator.AdvanceTo(time)
        states.append(np.array(port.Eval(context)))
    return _measure(robot, np.array(states))


def _measure(robot: Robot, states: Array) -> Drop:
    feet = kinematics.foot_positions(robot, states[-1, quadruped.JOINT_POSITION])
    return Drop(
        stance=float(np.mean(feet[[0, 2], 1] - feet[[1, 3], 1])),
        height=float(states[-1, quadruped.POSITION][2]),
        penetration=float(max(0.0, -kinematics.foot_heights(robot, states).min())),
    )
