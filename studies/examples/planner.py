"""Drives the closed loop by a planner, which sends the robot to a goal.

    python -m glassgait.studies.examples.planner

The planner sets the loop's command from the state of the plant. The script prints where the robot
is after 10 s.
"""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem

from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import make_simulator, stop_at_falls
from glassgait.models.policies.library import load_student
from glassgait.models.robots import quadruped
from glassgait.models.robots.kinematics import rotation_matrix
from glassgait.models.task.gait import load_gait

GOAL = np.array([2.0, 1.5, 0.0])  # m
REACHED = 0.3  # m
SPEED = 0.5  # m/s
GAIN = 1.5  # rad/s by rad


class Planner(LeafSystem):
    """Commands the robot to turn towards the goal, to walk there and to stop.

    Inputs: state (37), the plant's.
    Outputs: command (2; m/s, rad/s).
    """

    def __init__(self) -> None:
        super().__init__()
        n_states = quadruped.N_POSITIONS + quadruped.N_VELOCITIES
        self._state = self.DeclareVectorInputPort("state", n_states)
        self.DeclareVectorOutputPort("command", 2, self._calc_command)

    def _calc_command(self, context: Context, output: BasicVector) -> None:
        state = self._state.Eval(context)
        way = GOAL - state[quadruped.POSITION]
        ahead, aside, _ = rotation_matrix(state[quadruped.QUATERNION]).T @ way
        if np.hypot(ahead, aside) < REACHED:
            output.SetZero()
        else:
            # The loop limits the command to the gait's range.
            output.SetFromVector([SPEED, GAIN * np.arctan2(aside, ahead)])


def main() -> None:
    """Walks to the goal."""
    builder = DiagramBuilder()
    policy = load_student("trot", "formulas")
    loop = builder.AddSystem(MakeLocomotion(load_gait("trot"), policy=policy))
    planner = builder.AddSystem(Planner())
    builder.Connect(loop.GetOutputPort("state"), planner.GetInputPort("state"))
    # The rhythm, which stays unconnected, is drawn as the scenario says.
    builder.Connect(planner.GetOutputPort("command"), loop.GetInputPort("command"))
    simulator = make_simulator(builder.Build())
    stop_at_falls(simulator)
    simulator.AdvanceTo(10.0)
    state = loop.GetOutputPort("state").Eval(loop.GetMyContextFromRoot(simulator.get_context()))
    x, y, _ = state[quadruped.POSITION]
    print(f"after {simulator.get_context().get_time():.1f} s at {x:.2f} m, {y:.2f} m")


if __name__ == "__main__":
    main()
