"""The simplification study: an expert that walks learns to be copied by few terms."""

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
import torch
import tyro
from annotated_types import Ge, Le

from glassgait.diagrams.domain_randomization import DomainRandomization
from glassgait.models.errors import InputError
from glassgait.models.formulas.reader import read_formulas
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.settings import Count, Positive, Seed, Settings
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import ObservationLayout
from glassgait.models.task.odometry import Odometry
from glassgait.models.task.symmetry import mirrored_states
from glassgait.studies.distillation.learning_on import learning_on
from glassgait.studies.distillation.refinement.formula_network import FormulaNetwork
from glassgait.studies.distillation.simplification.page_pull import PagePull
from glassgait.studies.distillation.students.sparse_formula import (
    SPARSE_FORMULA,
    SparseFormulaSettings,
    condense,
)
from glassgait.studies.distillation.students.student import TrainingSet
from glassgait.studies.training.config import PpoConfig, TrainingConfig, Updates
from glassgait.studies.training.environment import TrainingEnvironment, observed_by_actor
from glassgait.studies.training.learner import Learner
from glassgait.studies.training.study import TrainingRun

Weight = Annotated[Positive, Le(1e4)]

SIMPLIFYING = PpoConfig(
    critic_updates=20,
    entropy=0.0003,
    final_entropy=0.0003,
    initial_std=0.33,
    kl_decay=(333, 500),
)
"""PPO of an expert that walks already, with about the spread that experts end with."""


@dataclass(frozen=True)
class SimplificationConfig(Settings):
    """Settings of a simplification.

    Attributes:
        seed: Seed of all randomness.
        updates: Number of PPO updates.
        terms: Terms of all formulas of the page that the expert is pulled to.
        first_weight: Weight, beside PPO's loss, of the mean squared difference between the
            expert's actions and the page's, at first.
        last_weight: The same weight in the end.
        weight_rise: Updates between which the weight rises from first to last, by equal factors.
        fit_updates: Updates from one page to the next, and from one checkpoint to the next.
        fit_samples: Most samples of those updates that a page is fitted to.
        n_robots: Robots that walk at once.
        worlds: The randomised scenarios that they walk in: those that experts learn in.
        ppo: Settings of PPO.
    """

    title: ClassVar[str] = "simplification"

    seed: Seed = 0
    updates: Count = 500
    terms: Annotated[Count, Ge(12)] = SparseFormulaSettings.terms
    first_weight: Weight = 0.2
    last_weight: Weight = 2.0
    weight_rise: Updates = (20, 400)
    fit_updates: Count = 10
    fit_samples: Count = 24_576
    n_robots: Count = 256
    worlds: Annotated[DomainRandomization, tyro.conf.arg(name="worlds")] = field(
        default_factory=DomainRandomization
    )
    ppo: PpoConfig = SIMPLIFYING

    def __post_init__(self) -> None:
        """Checks the settings.

        Raises:
            InputError: if the run would end between two pages, or before the pull has risen, or a
                page is fitted to fewer samples than it has terms.
        """
        super().__post_init__()
        if self.updates % self.fit_updates:
            raise InputError(
                f"simplification: updates is {self.updates}, and the run would end between two "
                f"pages; give a multiple of fit_updates = {self.fit_updates}"
            )
        first, last = self.weight_rise
        if self.updates < last:
            raise InputError(
                f"simplification: weight_rise ends at update {last}, and the run at "
                f"{self.updates}, before the last weight is reached; give --weight-rise "
                f"{min(first, self.updates // 5)} {self.updates * 4 // 5}"
            )
        steps = self.fit_updates * self.n_robots * self.ppo.steps_per_update
        if min(self.fit_samples, steps) < self.terms:
            raise InputError(
                f"simplification: a page of {self.terms} terms is fitted to fewer samples than "
                "terms; raise fit_samples, fit_updates or n_robots"
            )

    def weight(self, update: int) -> float:
        """Returns the weight of the pull in an update.

        Args:
            update: Updates done before it.
        """
        ends = np.log([self.first_weight, self.last_weight])
        return float(np.exp(np.interp(update, self.weight_rise, ends)))

    def training(self, gait: str, expert: NeuralPolicy) -> TrainingConfig:
        """Returns the settings as those of a run that learns.

        Args:
            gait: Name or file of the gait.
            expert: The expert to begin with.

        Raises:
            InputError: if it has no odometry, or other layers than are asked for, or there are too
                few robots for an update.
        """
        layers = expert.actor.plain.hidden_layers
        if self.ppo.actor_layers not in (layers, PpoConfig.actor_layers):
            raise InputError(
                f"simplification: ppo.actor_layers is {self.ppo.actor_layers}, and the expert of "
                f"the {gait} has layers of {layers}, which it keeps; leave the setting out"
            )
        if not isinstance(expert.estimator, Odometry):
            raise InputError(
                f"{gait}: its expert's estimator is a network, which formulas cannot say; train "
                "one with --senses imu or odometry, and name its run with --source"
            )
        return learning_on(
            self.worlds,
            robot=expert.robot.source,
            law=expert.joint_law,
            gait=gait,
            seed=self.seed,
            updates=self.updates,
            n_robots=self.n_robots,
            checkpoint_updates=self.fit_updates,
            mirrored=expert.mirrored_states is not None,
            senses="imu" if expert.layout.imu else "odometry",
            odometry=expert.estimator,
            ppo=replace(self.ppo, actor_layers=layers),
        )


class SimplificationRun(TrainingRun):
    """A simplification in its folder.

    Reward and termination are training's usual ones, whatever the expert learned with.

    Attributes:
        pull: The pull of the expert towards its page.
    """

    def __init__(
        self,
        config: SimplificationConfig,
        gait: Gait,
        expert: NeuralPolicy,
        folder: Path,
        *,
        resume: bool = False,
    ) -> None:
        """
        Args:
            config: Settings; a resumed run must have the same, except for more updates.
            expert: The expert to begin with.
            folder: Where the expert, its page, checkpoint, curve and TensorBoard events go.
            resume: Whether to continue from the folder's checkpoint.

        Raises:
            InputError: if there is nothing to resume, or it is damaged, or a page of the gait
                cannot have so many terms, or formulas cannot say how the expert observes.
        """
        mirrored = expert.mirrored_states is not None
        SparseFormulaSettings(terms=config.terms, mirrored=mirrored).refuse_for(gait)
        self._simplification = config
        self._expert = expert
        self.pull = PagePull()
        self._seen: list[torch.Tensor] = []
        super().__init__(config.training(gait.name, expert), gait, folder, resume=resume)
        if resume:
            self.pull.page = FormulaNetwork(self.page())

    def update(self) -> dict[str, float]:
        """Collects one batch of steps, learns from it, and returns the row of the curve."""
        self.pull.weight = self._simplification.weight(self.progress.update)
        # The curve holds this very row, so that what is added here is in it.
        row = super().update()
        # Robots' steps stay in the storage until the next ones are written over them.
        stored = self.learner.ppo.storage.observations.flatten(0, 1)
        self._seen.append(observed_by_actor(stored).clone())
        row["weight"] = self.pull.weight
        difference = math.sqrt(row.pop("symmetry")) * self._expert.robot.action_scale
        row["page_error"] = math.nan if self.pull.page is None else difference
        if self.progress.update % self._simplification.fit_updates == 0:
            page = self._fit()
            self.progress.page = page.to_text()
            self.pull.page = FormulaNetwork(page)
            self._seen.clear()
        return row

    def page(self) -> FormulaPolicy:
        """Returns the newest page."""
        file = read_formulas(self.progress.page)
        return FormulaPolicy.from_file(file, self._expert.robot)

    def write_result(self) -> None:
        """Writes the expert as it is now and its page, their record and their curve."""
        self.page().save(self.folder / f"{SPARSE_FORMULA.name}{FormulaPolicy.suffix}")
        super().write_result()

    def _starts_as(self, layout: ObservationLayout) -> NeuralPolicy:
        return self._expert

    def _study(self) -> SimplificationConfig:
        return self._simplification

    def _begin(self) -> tuple[TrainingEnvironment, Learner]:
        environment, learner = super()._begin()
        self._law = self._expert.joint_law
        learner.ppo.symmetry = self.pull  # type: ignore[assignment]
        return environment, learner

    def _fit(self) -> FormulaPolicy:
        """Fits a page to what robots saw since the last one."""
        every = torch.cat(self._seen)
        observations = every[torch.randperm(len(every))[: self._simplification.fit_samples]]
        with torch.no_grad():
            actions = self.learner.ppo.actor.mlp(observations)
        samples = TrainingSet(
            self.gait.name,
            self.environment.simulator.layout.names,
            observations.double().numpy(),
            actions.double().numpy(),
            np.zeros(len(observations), dtype=bool),
            mirrored_states(self.gait),
            self._expert.robot,
        )
        n_terms = self._simplification.terms
        page = condense(samples, [n_terms], mirrored=self.config.mirrored)[n_terms]
        return page.with_estimator_of(self._expert)
