"""Settings of distillations and refinements, and the rounds of a distillation."""

import math
from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar, Literal

import tyro
from annotated_types import Ge, MinLen

from glassgait.diagrams.domain_randomization import (
    HARSH,
    DomainRandomization,
    GroupRanges,
    TerrainRanges,
)
from glassgait.models.errors import InputError
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import JointLaw
from glassgait.models.settings import DISTINCT, FEW, Count, Natural, Seed, Settings, checked
from glassgait.models.task import EPISODE_STEPS
from glassgait.models.task.gait import Gait
from glassgait.models.task.reward import RewardWeights
from glassgait.studies.common.settings_file import IN_FILE
from glassgait.studies.distillation.boosting import EbmSettings, GbmSettings, HistogramGbmSettings
from glassgait.studies.distillation.dataset import HELD_OUT_EVERY
from glassgait.studies.distillation.short_formulas import FormulasSettings
from glassgait.studies.distillation.students import ITSELF, STUDENTS, StudentKind, StudentSettings
from glassgait.studies.distillation.symbolic import SymbolicPerStateSettings, SymbolicSettings
from glassgait.studies.training.config import EXACT, CurriculumConfig, PpoConfig, TrainingConfig

Steps = Annotated[Count, Ge(2)]
"""Control steps of an episode; R² needs two samples of a held-out episode."""


@checked
class StudentsSettings(Settings):
    """Settings of the students, by kind."""

    title: ClassVar[str] = "distillation"

    gbm: GbmSettings = field(default_factory=GbmSettings)
    histogram_gbm: HistogramGbmSettings = field(default_factory=HistogramGbmSettings)
    ebm: EbmSettings = field(default_factory=EbmSettings)
    symbolic: SymbolicSettings = field(default_factory=SymbolicSettings)
    symbolic_per_state: SymbolicPerStateSettings = field(default_factory=SymbolicPerStateSettings)
    formulas: FormulasSettings = field(default_factory=FormulasSettings)

    def of(self, name: str) -> StudentSettings:
        return getattr(self, name, StudentSettings())


@checked
class DistillationConfig(Settings):
    """Settings of a distillation (paper, Algorithm 1 and Section III-B).

    Attributes:
        collector: Student that collects the samples of all. By default each student collects its
            samples itself, but gbm uses those of histogram_gbm. With `itself`, as in the paper, all
            students do.
        episodes: Episodes with alternation, the paper's max_episodes.
        episodes_per_round: Episodes that share an alternation ratio, the paper's n_f.
        episodes_per_fit: Episodes from one fit to the next, a divisor of episodes_per_round; by
            default equal to it. The paper fits after every episode: 1.
        alone_rounds: Further rounds, in which only the student acts; the paper has none.
        alone_episodes: Episodes of such a round; by default 16, or 48 for machines of more than
            two states. Formulas have a separate setting.
        overdue_weight: Weight of the samples of robots that wait: their RM state has lasted two
            control steps longer than commanded. By default 1, as in the paper, or 4 for machines of
            more than two states.
        speeds: Commanded forward speeds (m/s) that the episodes cycle through, limited to the
            gait's greatest. By default, speeds are drawn from the gait's range every 10 s. The
            paper's are 0, 0.25, 0.5 and 0.75.
        worlds: The randomised scenarios of the samples; by default those that experts train in.
        scenario: Name of a scenario that ships, or path of a scenario file, to collect samples in
            instead; its commands are not used.
    """

    title: ClassVar[str] = "distillation"

    gait: Annotated[str, tyro.conf.Suppress] = "trot"
    students: Annotated[tuple[StudentKind, ...], MinLen(1), FEW, DISTINCT] = tuple(STUDENTS)
    collector: StudentKind | Literal["itself"] | None = None
    seed: Seed = 0
    episodes: Count = 30
    episodes_per_round: Count = 4
    episodes_per_fit: Count | None = None
    alone_rounds: Natural = 8
    alone_episodes: Count | None = None
    alone_steps: Steps = 250
    episode_steps: Steps = 1000
    overdue_weight: Count | None = None
    speeds: Annotated[tuple[float, ...], MinLen(1), FEW] | None = None
    worlds: Annotated[DomainRandomization, IN_FILE] = field(default_factory=DomainRandomization)
    scenario: str | None = None
    settings: Annotated[StudentsSettings, IN_FILE] = field(default_factory=StudentsSettings)

    def __post_init__(self) -> None:
        if self.episodes_per_round % (self.episodes_per_fit or 1):
            raise InputError(
                "distillation: episodes_per_fit must be a divisor of episodes_per_round"
            )
        for kind in self.students:
            collector = self.settings.of(self.collector_of(kind))
            n_alone = collector.alone_episodes or self.alone_episodes or HELD_OUT_EVERY
            n_episodes = self.episodes + self.alone_rounds * n_alone
            if n_episodes < HELD_OUT_EVERY:
                raise InputError(
                    f"distillation: {n_episodes} episodes of {kind} are too few to hold one out"
                )

    def for_gait(self, gait: Gait, *, symmetric: bool = True) -> "DistillationConfig":
        """Returns the settings, with the gait's defaults for those that are not set.

        `symmetric` says whether the expert is. Raises an InputError for settings that do not suit
        the gait.
        """
        for kind in dict.fromkeys((*self.students, *map(self.collector_of, self.students))):
            self.settings.of(kind).refuse_for(gait, symmetric)

        # Robots wait more often if the machine has more than two states.
        episodes, weight = (16, 1) if gait.n_states <= 2 else (48, 4)
        return replace(
            self,
            alone_episodes=self.alone_episodes or episodes,
            overdue_weight=self.overdue_weight or weight,
        )

    def collector_of(self, kind: str) -> str:
        """Returns the kind of the student that collects a student's samples."""
        if self.collector == ITSELF:
            return kind
        return self.collector or STUDENTS[kind].collector or kind


@dataclass(frozen=True)
class Round:
    """Episodes of equal length that share a student and an alternation ratio.

    The expert acts every `period` control steps, or never if it is 0. Rounds and episodes are
    counted from 1.
    """

    number: int
    period: int
    episodes: range
    steps: int


def rounds(config: DistillationConfig, kind: str) -> list[Round]:
    """Lists the rounds in which a student collects samples; `config` is a result of `for_gait`."""
    # First the expert acts at every k-th step, with k growing from 1.
    size = config.episodes_per_fit or config.episodes_per_round
    planned = []
    for first in range(1, config.episodes + 1, size):
        episodes = range(first, min(first + size, config.episodes + 1))
        period = math.ceil(first / config.episodes_per_round)
        planned.append(Round(len(planned) + 1, period, episodes, config.episode_steps))

    # Then only the student acts. Kinds with a separate `alone_episodes` have full-length episodes.
    n_alone = config.settings.of(kind).alone_episodes
    steps = config.alone_steps if n_alone is None else config.episode_steps
    size = n_alone or config.alone_episodes
    assert size is not None
    for first in range(config.episodes + 1, config.episodes + config.alone_rounds * size, size):
        planned.append(Round(len(planned) + 1, 0, range(first, first + size), steps))
    return planned


REFINING = PpoConfig(
    critic_updates=10,
    entropy=0.002,
    entropy_decay=(50, 500),
    desired_kl=0.015,
    kl_decay=(500, 680),
    initial_std=0.4,
)
"""PPO settings for a policy that walks. With an `initial_std` of 0.15, formulas hardly changed."""

MILD = DomainRandomization(
    groups=GroupRanges(
        payload=(0.0, 2.5),
        motor_strength=(0.9, 1.1),
        gains=(0.9, 1.1),
        terrains=TerrainRanges(slope=12.5, amplitude=0.035, height=0.035),
    ),
    randomization=replace(HARSH, push_speed=1.2, latency=(0.0, 0.015)),
)
"""About half as hard as the experts' scenarios; in these, formulas got worse on level ground."""

FULL_DEMANDS = CurriculumConfig(initial_difficulty=1.0, initial_hardship=1.0)
"""No curriculum: full dwell, clearance, pushes and terrain from the first update on."""


@checked
class RefinementConfig(Settings):
    """Settings of a refinement.

    Attributes:
        candidate_updates: Updates from one candidate, and checkpoint, to the next. At the end of
            the run, the candidates walk without the expert, and the best is the result.
        candidate_steps: Control steps of a candidate's rollouts.
        n_robots: Number of robots in parallel.
    """

    title: ClassVar[str] = "refinement"

    seed: Seed = 0
    updates: Count = 700
    candidate_updates: Count = 50
    candidate_steps: Count = EPISODE_STEPS
    n_robots: Count = 256
    worlds: Annotated[DomainRandomization, IN_FILE] = MILD
    weights: Annotated[RewardWeights, IN_FILE] = EXACT
    ppo: Annotated[PpoConfig, IN_FILE] = REFINING

    def training(self, gait: str, robot: str, law: JointLaw) -> TrainingConfig:
        station = self.worlds.station.with_gains(load_robot(robot), law)
        return TrainingConfig(
            robot=robot,
            worlds=replace(self.worlds, station=station),
            limit_targets=law.limited,
            curriculum=FULL_DEMANDS,
            gait=gait,
            seed=self.seed,
            updates=self.updates,
            checkpoint_updates=self.candidate_updates,
            n_robots=self.n_robots,
            weights=self.weights,
            ppo=self.ppo,
        )
