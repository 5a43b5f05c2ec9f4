"""Builds the closed loop, logs its state by Drake's own log sink and prints how the robot fares.

    python -m glassgait.studies.examples.build_and_log

Three robots trot for 5 s, each with another sensor noise.
"""

from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import make_simulator, stop_at_falls
from glassgait.diagrams.scenario import Scenario
from glassgait.models.policies.library import load_expert
from glassgait.models.robots import kinematics
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import load_gait


def main() -> None:
    """Prints mean speeds and falls."""
    # The loop is one system of the diagram, the log of its output another.
    scenario = Scenario(command=FixedCommand(speed=0.5))
    loop = MakeLocomotion(load_gait("trot"), scenario, policy=load_expert("trot"))
    builder = DiagramBuilder()
    builder.AddSystem(loop)
    sink = LogVectorOutput(loop.GetOutputPort("state"), builder, CONTROL_PERIOD)
    diagram = builder.Build()

    falls = 0
    for seed in range(3):
        simulator = make_simulator(diagram, seed=seed)
        stop_at_falls(simulator)
        status = simulator.AdvanceTo(5.0)
        falls += status.reason() == status.ReturnReason.kReachedTerminationCondition
        log = sink.FindLog(simulator.get_context())
        speed = kinematics.base_velocity(log.data().T)[0][:, 0]
        after_start = log.sample_times() > 1.0
        print(f"robot {seed}: {speed[after_start].mean():.3f} m/s, 0.5 m/s commanded")
    print(f"falls: {falls} of 3")


if __name__ == "__main__":
    main()
