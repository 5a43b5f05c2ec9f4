"""Uses a leaf system of your own as the policy: a hand-written trot.

    python -m glassgait.studies.examples.own_policy

The system reads the state of the reward machine and the time in it, lifts one diagonal pair of feet
at a time and swings it forward. It prints how far the robot gets in 5 s.
"""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import make_simulator, stop_at_falls
from glassgait.diagrams.scenario import Scenario
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.gait import load_gait

DWELL = 8  # control steps in a state
LIFT = 0.7  # rad, how far a knee bends in the air
STRIDE = 0.2  # rad, how far a thigh swings

SWINGING = np.array([[False, True, True, False], [True, False, False, True]])
"""Which of FL, FR, RL, RR swing in each state of the trot."""


class HandWrittenTrot(LeafSystem):
    """Computes actions from the reward machine only.

    Inputs: rm_state (2, one-hot), rm_iterations (1, control steps).
    Outputs: actions (12).
    """

    def __init__(self) -> None:
        super().__init__()
        self._rm_state = self.DeclareVectorInputPort("rm_state", len(SWINGING))
        self._iterations = self.DeclareVectorInputPort("rm_iterations", 1)
        self.DeclareVectorOutputPort("actions", quadruped.N_JOINTS, self._calc_actions)

    def _calc_actions(self, context: Context, output: BasicVector) -> None:
        swings = SWINGING[np.argmax(self._rm_state.Eval(context))]
        phase = min(self._iterations.Eval(context)[0] / DWELL, 1.0)
        # Feet rise until the state ends, and come down fast in the next one. Thighs of feet in the
        # air swing forward, the others back.
        bend = LIFT * np.where(swings, phase, max(0.0, 1.0 - 3.0 * phase))
        swing = STRIDE * np.where(swings, 1.0, -1.0) * (1.0 - 2.0 * phase)
        hips = np.zeros(quadruped.N_LEGS)
        targets = np.stack([hips, swing + 0.5 * bend, -bend], axis=1).ravel()
        output.SetFromVector(targets / load_robot().action_scale)


def main() -> None:
    """Trots for 5 s."""
    scenario = Scenario(command=FixedCommand(speed=0.3, dwell=DWELL))
    builder = DiagramBuilder()
    loop = builder.AddSystem(MakeLocomotion(load_gait("trot"), scenario))
    policy = builder.AddSystem(HandWrittenTrot())
    # Without a policy the loop has an input for actions.
    for name in ("rm_state", "rm_iterations"):
        builder.Connect(loop.GetOutputPort(name), policy.GetInputPort(name))
    builder.Connect(policy.GetOutputPort("actions"), loop.GetInputPort("action"))
    simulator = make_simulator(builder.Build())
    stop_at_falls(simulator)
    simulator.AdvanceTo(5.0)
    context = simulator.get_context()
    state = loop.GetOutputPort("state").Eval(loop.GetMyContextFromRoot(context))
    ahead, aside, height = state[quadruped.POSITION]
    print(
        f"after {context.get_time():.1f} s: {ahead:.2f} m ahead, {aside:+.2f} m aside, "
        f"{height:.2f} m high"
    )


if __name__ == "__main__":
    main()
