"""The settings of a distillation: its command line and its record."""

from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar, Literal

from annotated_types import Ge, Le, Lt, MinLen
from pydantic import AfterValidator

from glassgait.models.errors import InputError
from glassgait.models.settings import DISTINCT, FEW, Count, Natural, Seed, Settings, Share
from glassgait.models.task.gait import Gait
from glassgait.studies.distillation.collection import HELD_OUT_EVERY

StudentKind = Literal[
    "open_loop",
    "linear",
    "statewise_linear",
    "gbm",
    "histogram_gbm",
    "ebm",
    "symbolic",
    "statewise_symbolic",
]

STUDENT_TITLES: dict[StudentKind, str] = {
    "open_loop": "Open loop",
    "linear": "Linear",
    "statewise_linear": "Linear per RM state",
    "gbm": "GBM",
    "histogram_gbm": "GBM, histograms",
    "ebm": "EBM",
    "symbolic": "Symbolic",
    "statewise_symbolic": "Symbolic per RM state",
}

FORMULAS: tuple[StudentKind, ...] = ("symbolic", "statewise_symbolic")

Shape = tuple[int, int]

Depth = Annotated[Count, Le(16)]
"""Depth of a tree: compiled trees are complete, and of this depth have 65,536 leaves."""

Bins = Annotated[Count, Ge(3)]
"""Bins of an observation: interpret keeps one for missing values and one for unknown ones."""

Steps = Annotated[Count, Ge(2)]
"""Control steps of an episode: R² needs two samples of one that is held out."""


def _all_or_some(n_jobs: int) -> int:
    if n_jobs < 1 and n_jobs != -1:
        raise ValueError("1 or more, or -1 for as many as there are cores")
    return n_jobs


Jobs = Annotated[int, Lt(2**31), AfterValidator(_all_or_some)]
"""What is done at once, as joblib counts."""

Curriculum = Literal["alternation", "student_only", "expert_only", "half"]


@dataclass(frozen=True)
class GbmConfig(Settings):
    """Settings of scikit-learn's gradient boosting.

    The paper uses the library's defaults (100 trees, depth 3, all samples, all observations). These
    trees are deeper and more, and since each sees part of the data a fit takes less time. While
    samples are collected, histogram boosting stands in.

    Attributes:
        n_trees: Number of trees.
        depth: Depth of a tree.
        learning_rate: Share of a tree's correction that is kept.
        subsample: Share of the samples that a tree sees.
        feature_share: Share of the observations that a split may choose from.
    """

    title: ClassVar[str] = "distillation: gbm"

    n_trees: Count = 200
    depth: Depth = 7
    learning_rate: Share = 0.1
    subsample: Share = 0.25
    feature_share: Share = 0.3


@dataclass(frozen=True)
class HistogramGbmConfig(Settings):
    """Settings of scikit-learn's histogram gradient boosting, the fast one.

    Attributes:
        n_trees: Number of trees.
        level_trees: The same while samples are collected.
        depth: Greatest depth of a tree.
        leaves: Greatest number of leaves of a tree.
        learning_rate: Share of a tree's correction that is kept.
    """

    title: ClassVar[str] = "distillation: histogram_gbm"

    n_trees: Count = 300
    level_trees: Count = 150
    depth: Depth = 6
    leaves: Annotated[Count, Ge(2)] = 31
    learning_rate: Share = 0.1


@dataclass(frozen=True)
class EbmConfig(Settings):
    """Settings of interpret's explainable boosting.

    Attributes:
        outer_bags: Models that are averaged; how much they differ is the error band of every
            function. While samples are collected there is one.
        interactions: Functions of two observations, a joint.
        level_interactions: The same while samples are collected.
        max_bins: Bins of an observation.
        max_interaction_bins: Bins of an observation in functions of two.
        max_rounds: Greatest number of boosting rounds.
        learning_rate: Share of a round's correction that is kept.
        smoothing_rounds: Rounds of smooth fitting before the greedy ones.
        interaction_smoothing_rounds: The same, for functions of two.
    """

    title: ClassVar[str] = "distillation: ebm"

    outer_bags: Count = 4
    interactions: Natural = 200
    level_interactions: Natural = 60
    max_bins: Bins = 256
    max_interaction_bins: Bins = 24
    max_rounds: Count = 100
    learning_rate: Share = 0.2
    smoothing_rounds: Natural = 20
    interaction_smoothing_rounds: Natural = 5

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.max_interaction_bins > self.max_bins:
            # Joints could not share their bins: each would keep the finer ones where it has them.
            raise InputError(
                f"{self.title}: max_interaction_bins is {self.max_interaction_bins}, more than "
                f"max_bins = {self.max_bins}; lower it or raise max_bins"
            )


@dataclass(frozen=True)
class SymbolicConfig(Settings):
    """Settings of symbolic regression.

    Formulas are fitted in seconds, so they can afford more samples of their own than other
    students, and need them: with 4,000 a level alone, some of a bound fell in 10 of 52 rollouts.
    And they can afford a choice: of every shape and start weight, those that alone fall least, of
    these the simplest, if that costs little reward.

    Attributes:
        engine: `operon` works everywhere; `pysr` is the paper's and needs Julia.
        max_length: Greatest length of a formula in nodes, the paper's overall complexity (pysr).
            Lengths are as the engine counts: to Operon a weighted observation is one node, to PySR
            it is three.
        operator_complexity: Greatest complexity of an operator's operand (pysr).
        iterations: Iterations of the search (pysr).
        generations: Generations of the search (operon).
        population: Formulas in a generation (operon).
        coefficient_iterations: Steps of least squares on a new formula's coefficients (operon).
        shapes: Lengths of the sum that a formula starts from and of the whole formula, of which
            equal ones leave nothing to the engine (operon). Levels take the first.
        statewise_shapes: The same, where a joint has a formula for each state of the machine.
            Levels take the smallest: it strays furthest, and samples of where it goes serve the
            larger.
        start_weights: How often a sample of an episode's start counts. They are few and unlike all
            others: of R² 0.99 in all, formulas of a trot had 0.65 there. But where formulas are
            short, what the starts gain the gait loses. Levels, and PySR, take the first.
        max_samples: Samples that the search sees, drawn evenly (operon).
        alone_episodes: Episodes of a level in which formulas act alone.
    """

    title: ClassVar[str] = "distillation: symbolic"

    engine: Literal["operon", "pysr"] = "operon"
    max_length: Annotated[Count, Ge(7)] = 90
    operator_complexity: Count = 4
    iterations: Count = 20
    generations: Count = 100
    population: Annotated[Count, Ge(2)] = 200
    coefficient_iterations: Natural = 3
    shapes: Annotated[tuple[Shape, ...], MinLen(1), FEW] = ((90, 90), (64, 64), (74, 90))
    statewise_shapes: Annotated[tuple[Shape, ...], MinLen(1), FEW] = (
        (64, 64),
        (90, 90),
        (120, 120),
    )
    start_weights: Annotated[tuple[Count, ...], MinLen(1), FEW, DISTINCT] = (1, 20)
    max_samples: Count = 3000
    alone_episodes: Count = 13

    def __post_init__(self) -> None:
        super().__post_init__()
        for sum_length, length in (*self.shapes, *self.statewise_shapes):
            if not 1 <= sum_length <= length:
                raise InputError(
                    f"{self.title}: the shape {sum_length} {length} asks for a sum longer than its "
                    "formula, or for none; name the sum's length first"
                )

    def shapes_of(self, kind: StudentKind) -> tuple[Shape, ...]:
        """Returns the shapes of one kind of formulas."""
        return self.shapes if kind == "symbolic" else self.statewise_shapes

    def only(self, shape: Shape, start_weight: int) -> "SymbolicConfig":
        """Returns the settings of formulas that leave no choice."""
        return replace(
            self, shapes=(shape,), statewise_shapes=(shape,), start_weights=(start_weight,)
        )


@dataclass(frozen=True)
class DistillationConfig(Settings):
    """Settings of a distillation (paper, Algorithm 1 and Section III-B).

    Attributes:
        gait: Name of a gait.
        students: Kinds of students.
        seed: Seed of all randomness.
        episodes: Episodes in all, the paper's max_episodes.
        episodes_per_level: Episodes that share an alternation ratio, the paper's n_f.
        alone_levels: Levels after those of the curriculum in which the student acts alone. The
            paper has none, so that its students meet alone what no sample has shown them. A walk of
            boosted trees fell in 5 of 26 rollouts after two such levels and in none after eight.
        alone_episodes: Episodes of such a level; by default 16, and 48 for machines of more than
            two states: a walk of boosted trees fell in 12 of 520 rollouts with 16, in 3 with 48.
            Formulas have their own.
        alone_steps: Control steps of such an episode. An additive model of a bound fell within a
            second of the start, and of as many samples short episodes hold more starts.
        episode_steps: Control steps of the other episodes, and of those in which formulas act
            alone: they fall and start again often enough.
        curriculum: Who acts while samples are collected: `alternation`, the paper's, where level k
            has the expert act at every k-th step; or, after a first level of the expert's, the
            `student_only` (plain DAgger), the `expert_only` (behaviour cloning), or each at `half`
            of the steps.
        speeds: Commanded forward speeds that the episodes cycle through (m/s), at most the gait's.
        scenario: Name of a scenario that ships, or path of a scenario file: the world in which
            samples are collected, but for its commands.
        gbm: Settings of gradient boosting.
        histogram_gbm: Settings of histogram gradient boosting.
        ebm: Settings of explainable boosting.
        symbolic: Settings of symbolic regression.
        compact: Round the leaves and tables of trees and additive models to single precision, as
            those that ship are: actions differ by about 1e-7, files are half as large or less.
        n_jobs: Joints that are fitted at once.
    """

    title: ClassVar[str] = "distillation"

    gait: str = "trot"
    students: Annotated[tuple[StudentKind, ...], MinLen(1), FEW, DISTINCT] = tuple(STUDENT_TITLES)
    seed: Seed = 0
    episodes: Count = 30
    episodes_per_level: Count = 4
    alone_levels: Natural = 8
    alone_episodes: Count | None = None
    alone_steps: Steps = 250
    episode_steps: Steps = 1000
    curriculum: Curriculum = "alternation"
    speeds: Annotated[tuple[float, ...], MinLen(1), FEW] = (0.0, 0.25, 0.5, 0.75)
    scenario: str = "training"
    gbm: GbmConfig = field(default_factory=GbmConfig)
    histogram_gbm: HistogramGbmConfig = field(default_factory=HistogramGbmConfig)
    ebm: EbmConfig = field(default_factory=EbmConfig)
    symbolic: SymbolicConfig = field(default_factory=SymbolicConfig)
    compact: bool = False
    n_jobs: Jobs = 2

    def __post_init__(self) -> None:
        super().__post_init__()
        for kind in self.students:
            if self._least_episodes(kind) < HELD_OUT_EVERY:
                raise InputError(
                    f"distillation: of fewer than {HELD_OUT_EVERY} episodes none is held out to "
                    f"score {kind} with; raise episodes or alone_levels"
                )

    @property
    def curriculum_levels(self) -> int:
        """Levels of the curriculum, the last of which may have fewer episodes."""
        return -(-self.episodes // self.episodes_per_level)

    @property
    def n_levels(self) -> int:
        """All levels."""
        return self.curriculum_levels + self.alone_levels

    def for_gait(self, gait: Gait) -> "DistillationConfig":
        """Returns the settings with a gait's episodes alone, unless they are set.

        Raises:
            InputError: if a speed is further backward than the gait walks.
        """
        if min(self.speeds) < -gait.max_speed:
            raise InputError(
                f"distillation: speeds is {self.speeds}; name speeds of the {gait.name} from "
                f"{-gait.max_speed} to {gait.max_speed} m/s"
            )
        usual = 16 if gait.n_states <= 2 else 48
        return replace(self, alone_episodes=self.alone_episodes or usual)

    def level_episodes(self, level: int, kind: StudentKind) -> range:
        """Returns the numbers of a level's episodes, counted from 1, of settings for a gait."""
        if level <= self.curriculum_levels:
            size = self.episodes_per_level
            first = (level - 1) * size + 1
            return range(first, min(first + size, self.episodes + 1))
        size = self.symbolic.alone_episodes if kind in FORMULAS else self.alone_episodes
        assert size is not None
        first = self.episodes + (level - self.curriculum_levels - 1) * size + 1
        return range(first, first + size)

    def level_steps(self, level: int, kind: StudentKind) -> int:
        """Returns the control steps of a level's episodes."""
        short = level > self.curriculum_levels and kind not in FORMULAS
        return self.alone_steps if short else self.episode_steps

    def period(self, level: int) -> int:
        """Returns the control steps from one action of the expert to the next; 0 is never."""
        if level == 1:
            return 1
        if level > self.curriculum_levels:
            return 0
        return {"alternation": level, "student_only": 0, "expert_only": 1, "half": 2}[
            self.curriculum
        ]

    def _least_episodes(self, kind: StudentKind) -> int:
        alone = self.symbolic.alone_episodes if kind in FORMULAS else self.alone_episodes
        return self.episodes + self.alone_levels * (alone or HELD_OUT_EVERY)

    def for_levels(self) -> "DistillationConfig":
        """Returns the settings of the students that collect samples: small models, quickly made."""
        n_trees = min(self.histogram_gbm.level_trees, self.histogram_gbm.n_trees)
        interactions = min(self.ebm.level_interactions, self.ebm.interactions)
        return replace(
            self,
            histogram_gbm=replace(self.histogram_gbm, n_trees=n_trees),
            ebm=replace(self.ebm, outer_bags=1, interactions=interactions),
        )

    def for_shuffled_split(self) -> "DistillationConfig":
        """Returns the settings of the fit that is scored by the paper's split, without bands."""
        return replace(self, ebm=replace(self.ebm, outer_bags=1))
