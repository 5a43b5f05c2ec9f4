"""Drives the closed loop by a planner of one's own, which sends the robot to waypoints.

    python -m glassgait.studies.examples.planner

A trot on one page, which knows nothing of places, walks round two corners. It prints when the robot
reaches each waypoint.
"""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem, State

from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import make_simulator, stop_at_falls
from glassgait.models.policies.library import load_student
from glassgait.models.robots import quadruped
from glassgait.models.robots.kinematics import rotation_matrix
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import load_gait

WAYPOINTS = np.array([[1.5, 0.0], [2.5, 1.0], [2.5, 2.5]])  # m
REACHED = 0.3  # m
SPEED = 0.5  # m/s
GAIN = 1.5  # rad/s by rad


class Planner(LeafSystem):
    """Turns the robot towards the next waypoint, and lets it walk there.

    .. pydrake_system::

        name: Planner
        input_ports:
        - state
        output_ports:
        - command

    Inputs: state (37), the plant's.
    Outputs: command (2; m/s, rad/s).
    State: number of the next waypoint (1), latched every 20 ms (unrestricted update). Feedthrough:
    yes.
    """

    def __init__(self) -> None:
        super().__init__()
        self._state = self.DeclareVectorInputPort(
            "state", quadruped.N_POSITIONS + quadruped.N_VELOCITIES
        )
        self._next = self.DeclareDiscreteState(1)
        self.DeclareVectorOutputPort("command", 2, self._calc_command)
        self.DeclarePeriodicUnrestrictedUpdateEvent(CONTROL_PERIOD, 0.0, self._choose)

    def next_waypoint(self, context: Context) -> int:
        """Returns the number of the next waypoint; their count once all are reached."""
        return int(context.get_discrete_state(self._next)[0])

    def _way(self, context: Context) -> np.ndarray:
        """Returns the way to the next waypoint in the trunk's frame (2; m)."""
        state = self._state.Eval(context)
        way = np.zeros(3)
        way[:2] = WAYPOINTS[self.next_waypoint(context)] - state[quadruped.POSITION][:2]
        return (rotation_matrix(state[quadruped.QUATERNION]).T @ way)[:2]

    def _choose(self, context: Context, after: State) -> None:
        number = self.next_waypoint(context)
        if number < len(WAYPOINTS) and np.linalg.norm(self._way(context)) < REACHED:
            print(f"waypoint {number + 1} after {context.get_time():.1f} s")
            after.get_mutable_discrete_state(self._next)[0] = number + 1

    def _calc_command(self, context: Context, output: BasicVector) -> None:
        if self.next_waypoint(context) == len(WAYPOINTS):
            output.SetZero()
            return
        ahead, aside = self._way(context)
        # The loop limits it to what the gait is made for.
        output.SetFromVector([SPEED, GAIN * np.arctan2(aside, ahead)])


def main() -> None:
    """Walks round two corners."""
    builder = DiagramBuilder()
    loop = builder.AddSystem(
        MakeLocomotion(load_gait("trot"), policy=load_student("trot", "sparse_formula"))
    )
    planner = builder.AddSystem(Planner())
    builder.Connect(loop.GetOutputPort("state"), planner.GetInputPort("state"))
    # The input that stays unconnected, the rhythm, is drawn as the scenario says.
    builder.Connect(planner.GetOutputPort("command"), loop.GetInputPort("command"))
    simulator = make_simulator(builder.Build())
    stop_at_falls(simulator)
    simulator.AdvanceTo(10.0)
    context = simulator.get_context()
    x, y, _ = loop.GetOutputPort("state").Eval(loop.GetMyContextFromRoot(context))[
        quadruped.POSITION
    ]
    print(f"after {context.get_time():.1f} s at {x:.2f} m, {y:.2f} m")


if __name__ == "__main__":
    main()
