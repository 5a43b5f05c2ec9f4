"""Rollouts of the locomotion diagram, recorded at every control step."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from itertools import count

import numpy as np
from pydrake.common import RandomGenerator
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Diagram

from diagrams.locomotion import set_plant_state
from models.a1.robot import Array
from models.task import CONTROL_PERIOD
from systems.command import RandomCommand

RECORDED_PORTS = (
    "actions",
    "observations",
    "reward",
    "plain_reward",
    "reward_terms",
    "rm_state",
    "rm_iterations",
    "foot_contact",
    "foot_height",
    "failures",
    "command",
    "commanded_dwell",
    "state",
)

KEPT_STEPS = round(60.0 / CONTROL_PERIOD)
"""Control steps that are kept of a rollout without an end: those of its last minute."""


@dataclass(frozen=True)
class Rollout:
    """Values of the diagram's outputs at control steps 0..n, before each step's updates.

    Attributes:
        time: Instants (n + 1; s).
        values: Outputs by port name, each (n + 1, size).
    """

    time: Array
    values: dict[str, Array]

    def __getitem__(self, port: str) -> Array:
        return self.values[port]

    @property
    def failed(self) -> bool:
        """Whether the rollout ended in a failure."""
        return bool(self["failures"][-1].any())


def make_simulator(
    diagram: Diagram,
    *,
    state: Array | None = None,
    seed: int = 0,
    accuracy: float | None = None,
    realtime_rate: float = 0.0,
) -> Simulator:
    """Makes a simulator that is ready to advance.

    Args:
        diagram: What `MakeLocomotion` built.
        state: The plant's initial state x (37); standing at rest by default.
        seed: Seed of the diagram's random sources and of its drawn commands.
        accuracy: Accuracy of the error-controlled contact integrator, for a continuous plant.
        realtime_rate: Greatest speed in wall time; 0 is as fast as can be.
    """
    context = diagram.CreateDefaultContext()
    diagram.SetRandomContext(context, RandomGenerator(seed))
    command = diagram.GetSubsystemByName("command")
    if isinstance(command, RandomCommand):
        command.set_seed(command.GetMyMutableContextFromRoot(context), seed)
    set_plant_state(diagram, context, state)
    simulator = Simulator(diagram, context)
    if accuracy is not None:
        use_error_control(simulator, accuracy)
    simulator.set_target_realtime_rate(realtime_rate)
    simulator.Initialize()
    return simulator


def use_error_control(simulator: Simulator, accuracy: float) -> None:
    """Advances a continuous plant by the error-controlled contact integrator."""
    config = SimulatorConfig(integration_scheme="cenic", accuracy=accuracy, use_error_control=True)
    ApplySimulatorConfig(config, simulator)


def record(
    simulator: Simulator,
    n_steps: int | None,
    *,
    stop_on_failure: bool = True,
    stopped: Callable[[], bool] = lambda: False,
) -> Rollout:
    """Advances by control steps and records every output.

    Args:
        simulator: A simulator at a control instant.
        n_steps: Control steps to take; None goes on until stopped or failed, and keeps the last
            minute.
        stop_on_failure: Whether to end at the first failure.
        stopped: Asked after every step whether to end now.
    """
    diagram, context = simulator.get_system(), simulator.get_context()
    ports = {
        name: diagram.GetOutputPort(name) for name in RECORDED_PORTS if diagram.HasOutputPort(name)
    }
    kept = None if n_steps is not None else KEPT_STEPS + 1
    recorded: dict[str, deque[Array]] = {name: deque(maxlen=kept) for name in ports}
    times: deque[float] = deque(maxlen=kept)
    start = context.get_time()
    for step in count() if n_steps is None else range(n_steps + 1):
        # AdvanceTo handles updates that are due where it starts and leaves those where it ends, so
        # even a call with the time it already has would act.
        if step > 0:
            simulator.AdvanceTo(start + step * CONTROL_PERIOD)
        times.append(context.get_time())
        for name, port in ports.items():
            recorded[name].append(port.Eval(context).copy())
        if stopped() or (stop_on_failure and recorded["failures"][-1].any()):
            break
    return Rollout(np.array(times), {name: np.array(values) for name, values in recorded.items()})
