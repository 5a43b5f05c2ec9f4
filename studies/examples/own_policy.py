"""Builds a diagram with a policy written by hand, a trot, and logs the robot's state.

    python -m glassgait.studies.examples.own_policy

The trot reads the state of the reward machine and the time in it, lifts one diagonal pair of feet
at a time and swings it forward. Three robots walk for 5 s, each with different sensor noise.
"""

import numpy as np
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput

from glassgait.diagrams import FixedCommand, MakeLocomotion, Scenario, make_simulator, record
from glassgait.models.arrays import Array
from glassgait.models.robots.kinematics import base_velocity

DWELL = 8  # control steps in a state
LIFT = 0.9  # rad, how far a knee bends in the air
STRIDE = 0.2  # rad, how far a thigh swings

SWINGING = np.array([[False, True, True, False], [True, False, False, True]])
"""Whether FL, FR, RL and RR swing, for each state of the trot."""


def trot(observation: Array) -> Array:
    """Maps the observation (55) to an action (12)."""
    swings = SWINGING[np.argmax(observation[44:46])]
    phase = min(10.0 * observation[46] / DWELL, 1.0)
    # Feet rise until the state ends, and come down fast in the next one. Thighs of feet in the air
    # swing forward, the others back.
    bend = LIFT * np.where(swings, phase, max(0.0, 1.0 - 3.0 * phase))
    swing = STRIDE * np.where(swings, 1.0, -1.0) * (1.0 - 2.0 * phase)
    offsets = np.stack([np.zeros(4), swing + 0.5 * bend, -bend], axis=1)
    return offsets.ravel() / 0.25


def main() -> None:
    """Prints mean speeds and falls."""
    builder = DiagramBuilder()
    scenario = Scenario(command=FixedCommand(speed=0.3, dwell=DWELL))
    robot = builder.AddSystem(MakeLocomotion("trot", scenario, policy=trot))
    log = LogVectorOutput(robot.GetOutputPort("state"), builder, publish_period=0.02)
    diagram = builder.Build()
    falls = 0
    for seed in range(3):
        simulator = make_simulator(diagram, seed=seed)
        falls += record(simulator, n_steps=250).failed
        speed = base_velocity(log.FindLog(simulator.get_context()).data().T)[0][:, 0]
        print(f"robot {seed}: {speed[50:].mean():.3f} m/s forward")
    print(f"falls: {falls} of 3")


if __name__ == "__main__":
    main()
