"""The settings of an evaluation: its command line and its record."""

from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal

import tyro

from glassgait.diagrams.station import StationConfig
from glassgait.models.errors import InputError
from glassgait.models.settings import Count, Interval, Seed, Settings
from glassgait.models.task import EPISODE_STEPS
from glassgait.models.task.gait import Gait


@dataclass(frozen=True)
class World:
    """What robots are evaluated in.

    Attributes:
        title: What tables call it.
        station: The station.
        accuracy: Accuracy of the error-controlled contact integrator, for a continuous plant.
        push_speed: Greatest horizontal velocity that a push adds, along each axis (m/s), about
            every 15 s; 0 for no pushes.
        true_body_state: Whether policies observe the true body state, not the estimator's.
        max_robots: Robots to roll out at most for a seed, where the physics is slow.
    """

    title: str
    station: StationConfig
    accuracy: float | None = None
    push_speed: float = 0.0
    true_body_state: bool = False
    max_robots: int | None = None


WorldName = Literal[
    "training",
    "sap_2ms",
    "similar_1ms",
    "lagged_0.5ms",
    "cenic_1e-5",
    "friction_0.5",
    "friction_1.25",
    "push_0.5",
    "push_1.0",
    "payload_2kg",
    "true_velocities",
]

_SAP_2MS = StationConfig(time_step=0.002)
_SIMILAR_1MS = StationConfig(time_step=0.001, contact_solver="similar")
_LAGGED_05MS = StationConfig(time_step=0.0005, contact_solver="lagged")
_CONTINUOUS = StationConfig(time_step=0.0)

WORLDS: dict[WorldName, World] = {
    "training": World("SAP 10 ms (training)", StationConfig()),
    "sap_2ms": World("SAP 2 ms", _SAP_2MS, max_robots=10),
    "similar_1ms": World("similar 1 ms", _SIMILAR_1MS, max_robots=6),
    "lagged_0.5ms": World("lagged 0.5 ms", _LAGGED_05MS, max_robots=4),
    "cenic_1e-5": World("CENIC 1e-5", _CONTINUOUS, accuracy=1e-5, max_robots=1),
    "friction_0.5": World("friction 0.5", StationConfig(friction=0.5)),
    "friction_1.25": World("friction 1.25", StationConfig(friction=1.25)),
    "push_0.5": World("pushes of 0.5 m/s", StationConfig(), push_speed=0.5),
    "push_1.0": World("pushes of 1 m/s", StationConfig(), push_speed=1.0),
    "payload_2kg": World("trunk + 2 kg", StationConfig(payload=2.0)),
    "true_velocities": World("true body state", StationConfig(), true_body_state=True),
}
"""The training physics, converged references of it, and disturbances."""

DISTILLED_SPEEDS = (0.0, 0.75)
"""Forward speeds of distillation (m/s), at most the gait's; students are evaluated there."""


def distilled_speeds(gait: Gait) -> tuple[float, float]:
    """Returns the least and the greatest forward speed of a gait's distillation (m/s)."""
    slowest, fastest = DISTILLED_SPEEDS
    return slowest, min(fastest, gait.max_speed)


@dataclass(frozen=True)
class RolloutConfig(Settings):
    """How robots are rolled out.

    Attributes:
        n_robots: Number of robots for each seed; the paper's 26.
        n_steps: Control steps of a rollout.
        seed: First seed of initial states, commands and noise.
        n_seeds: Number of seeds: seed, seed + 1, …; `--seeds` says the same, as it does of jobs.
        speed_range: Least and greatest commanded forward speed (m/s); the gait's by default.
    """

    title: ClassVar[str] = "rollouts"

    n_robots: Count = 26
    n_steps: Count = EPISODE_STEPS
    seed: Seed = 1000
    n_seeds: Annotated[Count, tyro.conf.arg(aliases=("--seeds",))] = 5
    speed_range: Interval | None = None

    def at_distilled_speeds(self, gait: Gait) -> "RolloutConfig":
        """Returns the settings with a gait's speeds of distillation, unless speeds are set."""
        return replace(self, speed_range=self.speed_range or distilled_speeds(gait))

    def refuse_speeds_beyond(self, gait: Gait) -> None:
        """Refuses commanded speeds that the gait is not made for.

        Raises:
            InputError: if a speed is greater than the gait's greatest, forward or backward.
        """
        if any(abs(speed) > gait.max_speed for speed in self.speed_range or ()):
            raise InputError(
                f"rollouts: speed_range is {self.speed_range}; name speeds of the {gait.name} "
                f"from {-gait.max_speed} to {gait.max_speed} m/s"
            )

    @property
    def seeds(self) -> range:
        """Every seed."""
        return range(self.seed, self.seed + self.n_seeds)
