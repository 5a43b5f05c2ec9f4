"""`glassgait distill --sweep terms`: closed-loop return of formulas against their size."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, ClassVar

import pandas as pd
import tyro
from annotated_types import MinLen

from glassgait.models.errors import InputError
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_policy
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.settings import DISTINCT, FEW, Count, Natural
from glassgait.studies.common.cases import Case, not_finite_lines, score
from glassgait.studies.common.console import say
from glassgait.studies.common.experiment import PolicyNames, Report, RolloutExperiment
from glassgait.studies.common.policies import EXPERT
from glassgait.studies.common.rollouts import SELECTION_SEEDS
from glassgait.studies.common.run_folder import CHECKPOINT_NAME, default_folder, digest_of_files
from glassgait.studies.common.scores import summary
from glassgait.studies.common.sweep import gaits_named
from glassgait.studies.distillation.config import usual_overdue_weight
from glassgait.studies.distillation.formula_families import (
    FAMILIES,
    families_of,
    sizes_of,
)
from glassgait.studies.distillation.pareto_figure import pareto_figure
from glassgait.studies.distillation.refinement.config import RefinementConfig
from glassgait.studies.distillation.refinement.study import RefinementRun
from glassgait.studies.distillation.students.dataset import (
    Dataset,
    load_rounds_of,
    r2_scores,
    round_paths,
)
from glassgait.studies.distillation.students.library import samples_folder
from glassgait.studies.distillation.students.sparse_formula import (
    SPARSE_FORMULA,
    condense,
)
from glassgait.studies.distillation.students.symbolic import readings_of
from glassgait.studies.training.command import show_learning

TERMS = (30, 40, 50, 70, 100, 140, 200, 300)
"""Numbers of terms of all formulas together."""


SHARES = (0.0, 0.9, 0.97)
"""Shares of the expert's return for which the smallest formulas are named."""

MIN_RHYTHM = 0.9
"""Share of the rhythm below which a robot does not walk."""


@dataclass(frozen=True)
class Pareto(RolloutExperiment):
    """Fit formulas of growing size, let each walk alone, and name the smallest that walk.

    As many robots of a seed of its own choose the smallest formulas, and are not reported.

    Attributes:
        samples: Folder of the rounds that a student collected, whose samples the formulas are
            fitted to; runs/distill/<gait>/sparse_formula by default.
        terms: Numbers of terms of all formulas together, of mirror images those of one.
        refined_updates: PPO updates in which mirrored formulas of each size learn on; none by
            default, since 100 take some 5 minutes of a core.
    """

    title: ClassVar[str] = "distill --sweep terms"
    one: ClassVar[tuple[str, ...]] = ("scenario",)
    axes: ClassVar[Mapping[str, str]] = {"formulas": "acting", "purpose": "purposes"}
    purposes: ClassVar[tuple[str, ...]] = ("choosing", "reported")
    prepared: ClassVar[tuple[str, ...]] = ("formulas",)
    inputs: ClassVar[Mapping[str, str]] = {"samples": "digest_of_rounds"}

    policy: Annotated[PolicyNames, tyro.conf.Fixed] = (EXPERT,)
    samples: Path | None = None
    terms: Annotated[tuple[Count, ...], MinLen(1), FEW, DISTINCT] = TERMS
    refined_updates: Natural = 0

    def __post_init__(self) -> None:
        """Checks the settings.

        Raises:
            InputError: if the samples of one gait are named for several.
        """
        super().__post_init__()
        if self.samples is not None and len(gaits_named(self.gait)) > 1:
            raise InputError("--samples: are those of one gait; name one with --gait")

    @property
    def expert(self) -> NeuralPolicy:
        """The expert that formulas imitate."""
        return self.policies[self.gaits[0].name].expert

    @property
    def rounds(self) -> Path:
        """The folder of the samples."""
        distilled = default_folder("distill", self.expert.robot.name) / self.gaits[0].name
        return self.samples or samples_folder(distilled, SPARSE_FORMULA.name)

    @property
    def digest_of_rounds(self) -> str:
        """A digest of the samples, asked for before the run's folder is made.

        Raises:
            InputError: if there are none, or they are of another gait or expert.
        """
        if self.samples is None and not any(self.rounds.glob("round_*")):
            raise InputError(
                f"{self.rounds}: holds no samples; collect them with 'glassgait distill --gait "
                f"{self.gait[0]}{self.expert.robot.option} --students {SPARSE_FORMULA.name}', or "
                "name others with --samples"
            )
        _ = self.data
        return digest_of_files(round_paths(self.rounds))

    @cached_property
    def data(self) -> Dataset:
        """The samples, those that are held out with them."""
        return load_rounds_of(self.rounds, self.gaits[0], self.expert)

    @cached_property
    def formulas(self) -> dict[str, FormulaPolicy]:
        """Formulas of every size, by family and terms; those that the folder lacks are made.

        Raises:
            InputError: if no family has as many terms as are asked for.
        """
        gait = self.gaits[0]
        samples = self.data.subset(~self.data.held_out).training_set(gait, self.expert)
        names, robot = samples.observation_names, samples.robot
        ranges = readings_of(gait, robot, names, samples.observations)
        samples = samples.with_overdue(usual_overdue_weight(gait))
        folder, suffix, found = self.folder / "formulas", FormulaPolicy.suffix, {}
        families = families_of(samples, refined=self.refined_updates > 0)
        for name, family in families.items():
            say(f"making formulas: {family.title}")
            sizes = sizes_of(family, samples, self.terms)
            others = [str(n_terms) for n_terms in self.terms if n_terms not in sizes]
            if others:
                own = family.possible_terms(samples)
                say(
                    f"left out: {', '.join(others)} terms, since these formulas of the {gait.name} "
                    f"have {own.start} to {own.stop - 1} in all"
                )
            paths = {n_terms: folder / f"{name}_{n_terms}{suffix}" for n_terms in sizes}
            lacking = [n_terms for n_terms, path in paths.items() if not path.exists()]
            fitted = condense(samples, lacking, mirrored=family.mirrored) if lacking else {}
            for n_terms, page in fitted.items():
                start = page.with_readings(ranges).with_machine(gait)
                made = self._refined(start, paths[n_terms]) if family.refined else start
                made = made.with_estimator_of(self.expert)
                made.with_joint_law(self.expert.joint_law).save(paths[n_terms])
            for n_terms, path in paths.items():
                student = load_policy(path)
                assert isinstance(student, FormulaPolicy)
                found[f"{name} {n_terms}"] = student
        if not found:
            possible = [family.possible_terms(samples) for family in families.values()]
            least, most = min(own.start for own in possible), max(own.stop for own in possible) - 1
            raise InputError(
                f"{self.title}: terms is {self.terms}; the formulas of the {gait.name} have "
                f"{least} to {most} terms in all, so ask for as many"
            )
        return found

    @property
    def acting(self) -> dict[str, Policy]:
        """What walks alone: the expert, whose return is the measure, and all formulas."""
        return {EXPERT: self.expert, **self.formulas}

    def measure(self, case: Case) -> pd.DataFrame:
        """Rolls robots out that choose, or robots of one seed that are reported."""
        seed = case.seed
        if case.labels["purpose"] == "choosing":
            if seed != self.seed:
                return pd.DataFrame()
            seed = SELECTION_SEEDS[0]
        controller = alone(case.values["formulas"], case.alone.expert)
        own = replace(case, controller=controller, seed=seed)
        return score(own.with_config(self.rollouts(own)))

    def report(self, table: pd.DataFrame) -> Report:
        """Reports share of the return, falls and R² by size, and the smallest that walk."""
        gait, held_out = self.gaits[0].name, self.data.subset(self.data.held_out)
        fits = [
            {
                "policy": label,
                "family": label.split()[0],
                "terms": own.n_terms(),
                "r2": float(r2_scores(own, held_out).mean()),
            }
            for label, own in self.formulas.items()
        ]
        scores = table.drop(columns="policy").rename(columns={"formulas": "policy"})
        choosing, front = (
            pareto_table(pd.DataFrame(fits), scores[scores["purpose"] == purpose])
            for purpose in self.purposes
        )
        smallest = smallest_that_walk(choosing, front)
        shown, lines = {f"{gait}: formulas alone": front}, not_finite_lines(table)
        if len(smallest):
            shown[
                f"{gait}: the smallest with which every robot of seed {SELECTION_SEEDS[0]} walks, "
                "and what others do"
            ] = smallest
        else:
            lines.append(f"{gait}: with none of these sizes does every robot walk")
        return Report(
            tables={"selection": choosing, "pareto": front, "smallest": smallest},
            metrics=front.to_dict(orient="records"),
            figures={"pareto": pareto_figure({gait.capitalize(): front})},
            shown=shown,
            lines=lines,
        )

    def _refined(self, start: FormulaPolicy, path: Path) -> Policy:
        """Lets formulas learn on, from their checkpoint if there is one."""
        say(f"refining {start.n_terms()} terms")
        config = RefinementConfig(updates=self.refined_updates)
        own = self.folder / "refined" / path.stem
        own.mkdir(parents=True, exist_ok=True)
        begun = (own / CHECKPOINT_NAME).exists()
        run = RefinementRun(
            config, self.gaits[0], self.expert, start, own, name=path.stem, resume=begun
        )
        show_learning(run)
        return load_policy(own / path.name)


def pareto_table(fits: pd.DataFrame, scores: pd.DataFrame) -> pd.DataFrame:
    """Joins the fits with their scores alone: share of the expert's return, and falls."""
    means = summary(scores, ["policy"], against=EXPERT)
    falls = ["robots", "falls", "fall_rate", "fall_rate_low", "fall_rate_high"]
    columns = [*falls, "share", "share_ci", "return", "return_ci", "rhythm"]
    front = fits.merge(means[["policy", *columns]], on="policy")
    return front.sort_values("terms", ignore_index=True)


def smallest_that_walk(choosing: pd.DataFrame, front: pd.DataFrame) -> pd.DataFrame:
    """Names the smallest formulas with which every robot walks, for growing shares of the return.

    A robot walks that does not fall and keeps the rhythm; the smallest formulas of all stand still.
    Where no size does, there is no row.

    Args:
        choosing: The front by which formulas are chosen.
        front: That of other robots, whose scores of the chosen formulas are reported.
    """
    walks = choosing[(choosing["falls"] == 0) & (choosing["rhythm"] >= MIN_RHYTHM)]
    walks = walks.sort_values("terms")
    others = front.set_index("policy")
    scores = ["terms", "r2", "share", "share_ci", "rhythm", "robots", "falls"]
    rows = []
    for share in SHARES:
        enough = walks[walks["share"] >= share]
        if len(enough):
            best = enough.iloc[0]
            title = FAMILIES[best["family"]].title
            own = others.loc[best["policy"], scores]
            rows.append({"share asked for": share, "formulas": title, **own})
    return pd.DataFrame(rows, columns=["share asked for", "formulas", *scores])
