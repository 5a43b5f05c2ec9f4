"""Settings of a training run, on the command line and in its record."""

from dataclasses import field
from typing import Annotated, ClassVar, Literal

import tyro
from annotated_types import Le, MaxLen, MinLen

from glassgait.diagrams.domain_randomization import DomainRandomization
from glassgait.models.errors import InputError
from glassgait.models.estimation.odometry import Odometry
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
Senses = Literal["learned", "odometry", "imu"]
Actor = Literal["dense", "local"]
Updates = Annotated[tuple[Natural, Natural], IN_ORDER]


@checked
class CurriculumConfig(Settings):
    """Settings of the curriculum.

    The difficulty scales the required dwell and clearance of transitions of the reward machine, and
    divides their grace. It grows after every update in which the robots kept enough of the
    commanded rhythm. When it is 1, the hardship, a factor on pushes and ground, grows after updates
    with few failures.

    Attributes:
        initial_difficulty: Difficulty at the start; 1 for no curriculum, as in the paper.
        rise: Growth of the difficulty after an update.
        required_rhythm: Least share of the commanded rhythm for the difficulty to grow.
        initial_hardship: Factor on the speed of pushes, and on slopes and heights, at the start.
        hardship_rise: Growth of the hardship after an update.
        most_failures: Greatest share of control steps with a failure for the hardship to grow.
        mujoco_updates: First updates, in which groups of Drake are in MuJoCo, which is faster.
    """

    title: ClassVar[str] = "training: curriculum"

    initial_difficulty: Share = 0.2
    rise: Fraction = 0.02
    required_rhythm: Fraction = 0.5
    initial_hardship: Share = 0.2
    hardship_rise: Fraction = 0.01
    most_failures: Fraction = 0.006
    mujoco_updates: Natural = 0


@checked
class PpoConfig(Settings):
    """Settings of PPO (rsl-rl).

    Attributes:
        steps_per_update: Control steps of each robot between two updates.
        critic_updates: Number of first updates that train only the critic, from random weights.
        entropy: Initial weight of the entropy, for exploration.
        final_entropy: Final weight of the entropy, for precision.
        entropy_decay: Updates at which the fall of the weight starts and ends.
        learning_rate: Initial learning rate, later adapted to the desired KL divergence.
        desired_kl: Initial KL divergence to which the learning rate is adapted.
        final_kl: Final KL divergence, smaller for smaller changes of the last policies.
        kl_decay: Updates at which the fall of the divergence starts and ends.
        reward_scale: Factor on the task's reward; a transition gives up to 30 without it.
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
    """Settings of the learned state estimator, which is trained with the steps of each update."""

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
"""Weights for precise tracking, a level trunk, and feet that neither slip nor swing too high."""


@checked
class TrainingConfig(Settings):
    """Settings of a training run.

    Attributes:
        gait: Name of a gait, or path of a gait file; the command accepts several.
        robot: Name of a shipped robot, or path of a `robot.yaml`.
        warm_start: Expert whose weights the actor starts from, of this robot and with as many RM
            states; by default the actor starts from random weights.
        n_robots: Number of robots that train in parallel.
        actor: `dense` as in the paper, or `local`: each leg's actions depend only on that leg and
            the body.
        friction_updates: Updates between two draws of frictions and changes of the ground.
        checkpoint_updates: Updates between two checkpoints.
        mirrored: Whether actor and estimator are symmetric, if the gait's reward machine is.
        limit_targets: Whether targets are limited to the joints' ranges, in training and whenever
            the expert acts.
        senses: Source of the body state: `learned` is the paper's, a network without an IMU that is
            trained with the actor; `odometry` estimates it from the IMU, the joints and the stance
            feet; with `imu` the actor also observes gravity and angular velocity.
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
        """The control of the joints in training, without final limits."""
        return JointLaw(self.worlds.station.gains(load_robot(self.robot)), self.limit_targets)

    @property
    def expert_law(self) -> JointLaw:
        """The control of the joints by the expert, with final limits if it has an IMU."""
        limited = self.limit_targets and self.senses == "imu"
        return self.joint_law.with_limits(load_robot(self.robot)) if limited else self.joint_law

    def __post_init__(self) -> None:
        n_groups = self.worlds.n_groups
        if n_groups > self.n_robots:
            raise InputError(
                f"training: n_robots is {self.n_robots}, fewer than n_groups = {n_groups}; raise it"
            )
        # PPO normalizes an update's advantages, which needs two steps.
        if self.steps_per_update < max(2, self.ppo.num_minibatches):
            raise InputError(
                f"training: an update of {self.steps_per_update} steps does not fill "
                f"{self.ppo.num_minibatches} num_minibatches of PPO; raise n_robots"
            )

    @property
    def steps_per_update(self) -> int:
        """Control steps of all robots between two updates."""
        return self.n_robots * self.ppo.steps_per_update
