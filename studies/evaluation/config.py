"""The settings of an evaluation: its command line and its record."""

from dataclasses import dataclass
from typing import Literal

from diagrams.station import StationConfig
from models.task import EPISODE_STEPS


@dataclass(frozen=True)
class World:
    """Physics to evaluate in.

    Attributes:
        title: What tables call it.
        station: The station.
        accuracy: Accuracy of the error-controlled contact integrator, for a continuous plant.
        n_robots: Robots to roll out at most, fewer where the physics is slow.
    """

    title: str
    station: StationConfig
    accuracy: float | None = None
    n_robots: int = 10**6


WorldName = Literal["training", "sap_2ms", "similar_1ms", "lagged_0.5ms", "cenic_1e-5"]

WORLDS: dict[WorldName, World] = {
    "training": World("SAP 10 ms (training)", StationConfig()),
    "sap_2ms": World("SAP 2 ms", StationConfig(time_step=0.002)),
    "similar_1ms": World("similar 1 ms", StationConfig(time_step=0.001, contact_solver="similar")),
    "lagged_0.5ms": World(
        "lagged 0.5 ms", StationConfig(time_step=0.0005, contact_solver="lagged")
    ),
    "cenic_1e-5": World("CENIC 1e-5", StationConfig(time_step=0.0), accuracy=1e-5, n_robots=4),
}
"""The training physics, and the converged references that finished policies are checked in."""

DISTILLED_SPEEDS = (0.0, 0.75)
"""Forward speeds that distillation commands (m/s); students are evaluated there."""


@dataclass(frozen=True)
class RolloutConfig:
    """How robots are rolled out.

    Attributes:
        n_robots: Number of robots; the paper's 26.
        n_steps: Control steps of a rollout.
        seed: Seed of initial states, commands and noise.
        speed_range: Least and greatest commanded forward speed (m/s); the gait's by default.
    """

    n_robots: int = 26
    n_steps: int = EPISODE_STEPS
    seed: int = 1000
    speed_range: tuple[float, float] | None = None
