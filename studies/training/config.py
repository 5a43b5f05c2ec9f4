"""The settings of a training run: its command line and its record."""

from dataclasses import field
from typing import Annotated, ClassVar, Literal

import tyro
from annotated_types import Le, MaxLen, MinLen

from glassgait.diagrams.domain_randomization import DomainRandomization
from glassgait.models.errors import InputError
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import DEFAULT_ROBOT, JointLaw
from glassgait.models.settings import (
    IN_ORDER,
    Count,
    Natural,
    NotNegative,
    Positive,
    Seed,
    Settings,
    Share,
    checked,
)
from glassgait.models.task.reward import RewardWeights
from glassgait.models.task.termination import TerminationLimits
from glassgait.studies.common.settings_file import IN_FILE

Fraction = Annotated[NotNegative, Le(1.0)]
LearningRate = Annotated[Positive, Le(1.0)]
Switch = Annotated[bool, tyro.conf.arg(help_behavior_hint="(without the flag: {})".format)]
Layers = Annotated[tuple[Annotated[Count, Le(4096)], ...], MinLen(1), MaxLen(16)]
Range = Annotated[tuple[NotNegative, NotNegative], IN_ORDER]
Senses = Literal["learned", "odometry", "imu"]
Actor = Literal["dense", "local"]
Updates = Annotated[tuple[Natural, Natural], IN_ORDER]


@checked
class CurriculumConfig(Settings):
    """Settings of the growth of the reward machine's demands during training.

    The difficulty scales the dwell and the clearance that a transition asks for, and divides its
    grace. It rises after every update in which the robots kept enough of the commanded rhythm. Once
    it is 1, pushes and ground grow by their hardship, as long as few robots fail.

    Attributes:
        initial_difficulty: Difficulty at the start; 1 is the paper's way, no curriculum.
        rise: How much the difficulty grows after an update.
        required_rhythm: Share of the commanded rhythm that lets the difficulty grow.
        initial_hardship: Share of the pushes' speed and of the ground at the start; 1 is all of it.
        hardship_rise: How much that grows after an update.
        most_failures: Greatest share of control steps with a failure that lets it grow.
    """

    title: ClassVar[str] = "training: curriculum"

    initial_difficulty: Share = 0.2
    rise: Fraction = 0.02
    required_rhythm: Fraction = 0.5
    initial_hardship: Share = 0.2
    hardship_rise: Fraction = 0.01
    most_failures: Fraction = 0.006


@checked
class PpoConfig(Settings):
    """Settings of PPO (rsl-rl).

    Attributes:
        steps_per_update: Control steps of each robot between two updates.
        critic_updates: First updates, in which only the critic learns, which begins anew.
        entropy: Weight of the entropy at first; robots keep trying.
        final_entropy: Weight of the entropy in the end; robots become precise.
        entropy_decay: Updates between which the weight falls from the one to the other.
        learning_rate: Initial learning rate, then adapted to the desired divergence.
        desired_kl: Divergence that the learning rate is adapted to at first.
        final_kl: The same in the end; the last policies differ less.
        kl_decay: Updates between which the divergence falls from the one to the other.
        reward_scale: Factor on the task's reward; a transition pays up to 30 before it.
    """

    title: ClassVar[str] = "training: ppo"

    steps_per_update: Count = 24
    critic_updates: Natural = 0
    epochs: Count = 5
    num_minibatches: Count = 4
    clip: Positive = 0.2
    gamma: Fraction = 0.99
    gae_lambda: Fraction = 0.95
    entropy: NotNegative = 0.006
    final_entropy: NotNegative = 0.0003
    entropy_decay: Updates = (100, 450)
    learning_rate: LearningRate = 1e-3
    desired_kl: Positive = 0.01
    final_kl: Positive = 0.002
    kl_decay: Updates = (800, 950)
    initial_std: Positive = 0.7
    reward_scale: Positive = 1.0 / 60.0
    actor_layers: Layers = (256, 128, 64)
    critic_layers: Layers = (256, 128, 64)


@checked
class EstimatorConfig(Settings):
    """Settings of the learned state estimator, which learns from the steps of each update."""

    title: ClassVar[str] = "training: estimator"

    layers: Layers = (128, 128)
    learning_rate: LearningRate = 1e-3
    epochs: Count = 1
    num_minibatches: Count = 4


EXACT = RewardWeights(
    forward_tracking=3.0,
    yaw_tracking=1.5,
    high_swing=-2.0,
    tilt=-2.0,
    slip=-0.1,
    tracking_width=0.1,
    tracking_time=0.2,
)
"""More of what makes robots go and turn as commanded, level, on feet that neither slip nor fly."""


@checked
class TrainingConfig(Settings):
    """Settings of a training run.

    Attributes:
        gait: Name of a gait, or path of a gait file; the command takes several.
        robot: Name of a robot that ships, or path of a `robot.yaml`.
        warm_start: Expert of this robot, of a machine with as many states, as which the actor
            begins; by default it begins anew.
        n_robots: Robots that train at once.
        actor: `dense` is the paper's; in a `local` one, each leg's actions depend only on that leg
            and the body.
        friction_updates: Updates between two draws of the frictions, and two grounds.
        checkpoint_updates: Updates between two checkpoints.
        mirrored: Whether the actor and the estimator treat left and right alike, where the gait's
            machine does.
        limit_targets: Whether joints follow the nearest targets within their ranges, in training
            and, as the expert's file says, from then on.
        senses: Where the body state comes from: `learned` is the paper's, a network that learns
            beside the actor, without an IMU; `odometry` estimates it by the IMU, the joints and the
            standing feet; with `imu` the actor observes gravity and angular velocity as well.
    """

    title: ClassVar[str] = "training"

    gait: Annotated[str, tyro.conf.Suppress] = "trot"
    robot: str = DEFAULT_ROBOT
    seed: Seed = 0
    warm_start: str | None = None
    updates: Count = 1000
    n_robots: Count = 256
    actor: Actor = "dense"
    worlds: Annotated[DomainRandomization, IN_FILE] = field(default_factory=DomainRandomization)
    friction_updates: Count = 20
    checkpoint_updates: Count = 50
    mirrored: Switch = True
    limit_targets: Switch = True
    senses: Senses = "imu"
    odometry: Annotated[Odometry, IN_FILE] = field(default_factory=Odometry)
    weights: Annotated[RewardWeights, IN_FILE] = EXACT
    limits: Annotated[TerminationLimits, IN_FILE] = field(default_factory=TerminationLimits)
    curriculum: Annotated[CurriculumConfig, IN_FILE] = field(default_factory=CurriculumConfig)
    ppo: Annotated[PpoConfig, IN_FILE] = field(default_factory=PpoConfig)
    estimator: Annotated[EstimatorConfig, IN_FILE] = field(default_factory=EstimatorConfig)

    @property
    def joint_law(self) -> JointLaw:
        """The control of the joints in training, where exploration may ask for anything."""
        return JointLaw(self.worlds.station.gains(load_robot(self.robot)), self.limit_targets)

    @property
    def expert_law(self) -> JointLaw:
        """The control of the joints by the expert: with limits that come last, if it has an IMU."""
        limited = self.limit_targets and self.senses == "imu"
        return self.joint_law.with_limits(load_robot(self.robot)) if limited else self.joint_law

    def __post_init__(self) -> None:
        n_groups = self.worlds.n_groups
        if n_groups > self.n_robots:
            raise InputError(
                f"training: n_robots is {self.n_robots}, fewer than n_groups = {n_groups}, and a "
                "group would have none; raise n_robots or lower n_groups"
            )
        layers = self.ppo.actor_layers
        if self.actor == "local" and any(width % quadruped.N_LEGS for width in layers):
            raise InputError(
                f"training: ppo.actor_layers is {layers}; a local actor has as many units for each "
                f"leg, so give multiples of {quadruped.N_LEGS}"
            )
        # PPO divides by the spread of an update's advantages, which one step does not have.
        if self.steps_per_update < max(2, self.ppo.num_minibatches):
            raise InputError(
                f"training: an update of {self.steps_per_update} steps does not fill "
                f"{self.ppo.num_minibatches} num_minibatches of PPO; raise n_robots or "
                "steps_per_update"
            )

    @property
    def steps_per_update(self) -> int:
        """Control steps of all robots between two updates."""
        return self.n_robots * self.ppo.steps_per_update
