"""Adds a leaf system of one's own, a power meter, beside the closed loop.

    python -m glassgait.studies.examples.own_leaf_system

It prints for three gaits the joints' power and the cost of transport: work by weight and way.
"""

import numpy as np
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem, State

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import make_simulator
from glassgait.diagrams.scenario import Scenario
from glassgait.models.policies.library import load_expert
from glassgait.models.robots import quadruped
from glassgait.models.robots.joint_law import OWN_LAW, JointLaw
from glassgait.models.robots.library import load_robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import load_gait

ROBOT = load_robot()
WEIGHT = 9.81 * ROBOT.mass  # N


class PowerMeter(LeafSystem):
    """Adds up the joints' work (J) at the power that each control step begins with.

    What a joint brakes it does not get back. Joints follow targets by a policy's law.
    """

    def __init__(self, law: JointLaw = OWN_LAW) -> None:
        super().__init__()
        self._law = law
        self._state = self.DeclareVectorInputPort(
            "state", quadruped.N_POSITIONS + quadruped.N_VELOCITIES
        )
        self._actions = self.DeclareVectorInputPort("actions", quadruped.N_JOINTS)
        self.DeclareStateOutputPort("work", self.DeclareDiscreteState(1))
        # Not a discrete update: those come after what the loop latches, and would see the next
        # observation's action.
        self.DeclarePeriodicUnrestrictedUpdateEvent(CONTROL_PERIOD, 0.0, self._add)

    def _add(self, context: Context, after: State) -> None:
        state, action = self._state.Eval(context), self._actions.Eval(context)
        position, velocity = state[quadruped.JOINT_POSITION], state[quadruped.JOINT_VELOCITY]
        torque = self._law.torque(ROBOT, action=action, position=position, velocity=velocity)
        work = np.maximum(torque * velocity, 0.0).sum() * CONTROL_PERIOD
        after.get_mutable_discrete_state(0)[0] += work


def main() -> None:
    """Walks, trots and paces for 5 s."""
    scenario = Scenario(command=FixedCommand(speed=0.5), sensor_noise=0.0)
    for gait in ("walk", "trot", "pace"):
        builder = DiagramBuilder()
        expert = load_expert(gait)
        loop = builder.AddSystem(MakeLocomotion(load_gait(gait), scenario, policy=expert))
        meter = builder.AddSystem(PowerMeter(expert.joint_law))
        for name in ("state", "actions"):
            builder.Connect(loop.GetOutputPort(name), meter.GetInputPort(name))
        simulator = make_simulator(builder.Build())
        simulator.AdvanceTo(5.0)
        context = simulator.get_context()
        (work,) = meter.get_output_port().Eval(meter.GetMyContextFromRoot(context))
        state = loop.GetOutputPort("state").Eval(loop.GetMyContextFromRoot(context))
        distance = state[quadruped.POSITION][0]
        cost = work / (WEIGHT * distance)
        print(f"{gait}: {work / 5:.0f} W, {distance:.2f} m, cost of transport {cost:.2f}")


if __name__ == "__main__":
    main()
