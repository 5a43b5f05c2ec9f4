"""The settings of a training run: its command line and its record."""

from dataclasses import dataclass, field, replace

from diagrams.station import StationConfig
from models.errors import InputError
from models.task.randomization import Randomization
from models.task.termination import TerminationLimits


@dataclass(frozen=True)
class CurriculumConfig:
    """How the reward machine's demands grow during training.

    An ease scales the dwell and the clearance that a transition asks for, and divides its grace. It
    rises after every update in which the robots kept enough of the commanded rhythm. At a low ease
    they may step faster than commanded; the rising dwell slows them down.

    Attributes:
        initial_ease: Ease at the start; 1 is the paper's way, no curriculum.
        rise: How much the ease grows after an update.
        required_rhythm: Share of the commanded rhythm that lets the ease grow.
    """

    initial_ease: float = 0.2
    rise: float = 0.02
    required_rhythm: float = 0.5


@dataclass(frozen=True)
class PpoConfig:
    """Settings of PPO (rsl-rl).

    Attributes:
        steps_per_update: Control steps of each robot between two updates.
        epochs: Passes over those steps.
        mini_batches: Mini-batches of a pass.
        clip: Clipping of the probability ratio.
        discount: Discount of the return.
        trace_decay: λ of the generalized advantage estimate.
        entropy: Weight of the entropy at first, which keeps the robots trying.
        final_entropy: Weight of the entropy in the end, which lets them become precise.
        entropy_decay: Updates between which the weight falls from the one to the other.
        learning_rate: Initial learning rate, then adapted to the desired divergence.
        desired_kl: Divergence that the learning rate is adapted to at first.
        final_kl: Divergence that it is adapted to in the end; a smaller one makes the last policies
            differ less.
        kl_decay: Updates between which the divergence falls from the one to the other.
        initial_std: Initial standard deviation of the actions.
        reward_scale: Factor on the task's reward; a transition pays up to 30 before it.
        actor_layers: Widths of the actor's hidden layers.
        critic_layers: Widths of the critic's hidden layers.
    """

    steps_per_update: int = 24
    epochs: int = 5
    mini_batches: int = 4
    clip: float = 0.2
    discount: float = 0.99
    trace_decay: float = 0.95
    entropy: float = 0.01
    final_entropy: float = 0.001
    entropy_decay: tuple[int, int] = (400, 600)
    learning_rate: float = 1e-3
    desired_kl: float = 0.01
    final_kl: float = 0.002
    kl_decay: tuple[int, int] = (1300, 1400)
    initial_std: float = 1.0
    reward_scale: float = 1.0 / 30.0
    actor_layers: tuple[int, ...] = (256, 128, 64)
    critic_layers: tuple[int, ...] = (256, 128, 64)


@dataclass(frozen=True)
class EstimatorConfig:
    """Settings of the learned state estimator.

    Attributes:
        layers: Widths of the hidden layers.
        learning_rate: Learning rate of Adam.
        epochs: Passes over the steps of each update.
        mini_batches: Mini-batches of a pass.
    """

    layers: tuple[int, ...] = (128, 128)
    learning_rate: float = 1e-3
    epochs: int = 1
    mini_batches: int = 4


@dataclass(frozen=True)
class TrainingConfig:
    """Settings of a training run.

    Attributes:
        gait: Name of a gait, or path of a gait file.
        seed: Seed of all randomness.
        updates: Number of PPO updates.
        n_robots: Robots that train at once.
        n_groups: Groups of robots, each with a station and a friction of its own.
        payloads: Masses on the trunks (kg) of one group each.
        fine_steps: Time steps (s) of the plants of one group each, finer than the station's. What
            only works in the coarse physics of the other groups is not learned.
        friction_updates: Updates between two draws of the frictions.
        checkpoint_updates: Updates between two checkpoints.
        station: Physics of the groups that are neither loaded nor fine.
        randomization: What differs between robots and episodes.
        limits: Bounds of the termination.
        curriculum: Growth of the reward machine's demands.
        ppo: Settings of PPO.
        estimator: Settings of the state estimator.
    """

    gait: str = "trot"
    seed: int = 0
    updates: int = 1450
    n_robots: int = 256
    n_groups: int = 8
    payloads: tuple[float, ...] = (2.0, 2.0)
    fine_steps: tuple[float, ...] = (0.005, 0.0025)
    friction_updates: int = 20
    checkpoint_updates: int = 50
    station: StationConfig = field(default_factory=StationConfig)
    randomization: Randomization = field(default_factory=Randomization)
    limits: TerminationLimits = field(default_factory=TerminationLimits)
    curriculum: CurriculumConfig = field(default_factory=CurriculumConfig)
    ppo: PpoConfig = field(default_factory=PpoConfig)
    estimator: EstimatorConfig = field(default_factory=EstimatorConfig)

    def __post_init__(self) -> None:
        special = len(self.payloads) + len(self.fine_steps)
        if special > self.n_groups:
            raise InputError(
                f"training: {special} payloads and fine steps do not fit in n_groups = "
                f"{self.n_groups}; raise n_groups or name fewer"
            )

    def stations(self) -> tuple[StationConfig, ...]:
        """Returns the physics of every group of robots."""
        loaded = [replace(self.station, payload=mass) for mass in self.payloads]
        fine = [replace(self.station, time_step=step) for step in self.fine_steps]
        ordinary = [self.station] * (self.n_groups - len(loaded) - len(fine))
        return (*ordinary, *loaded, *fine)
