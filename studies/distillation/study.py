"""Algorithm 1 of the paper for each student, one round at a time."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from joblib import delayed
from sklearn.model_selection import train_test_split
from threadpoolctl import threadpool_limits

from glassgait.diagrams.domain_randomization import DomainRandomization
from glassgait.diagrams.scenario import Scenario, load_scenario
from glassgait.models.errors import InputError
from glassgait.models.files import digest, read_record, write_atomically, write_record
from glassgait.models.formulas.latex import to_latex
from glassgait.models.policies.controller import Controller
from glassgait.models.policies.library import policy_path
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.reading_cost import READING_COST_TITLES, reading_cost
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.task.alternation import ratio_title
from glassgait.models.task.gait import Gait
from glassgait.studies.common.console import say
from glassgait.studies.common.jobs import run_parallel
from glassgait.studies.common.policies import EXPERT
from glassgait.studies.common.run import open_run
from glassgait.studies.common.tables import write_metrics, write_table
from glassgait.studies.distillation.boosting import fit_ensemble
from glassgait.studies.distillation.collection import collect
from glassgait.studies.distillation.config import DistillationConfig, Round, rounds
from glassgait.studies.distillation.dataset import Dataset, TrainingSet, r2_scores
from glassgait.studies.distillation.formulas import readings_of
from glassgait.studies.distillation.linear import (
    fit_linear,
    fit_linear_per_state,
    untrained_student,
)
from glassgait.studies.distillation.selection import rank_candidates, simplest_of_the_best
from glassgait.studies.distillation.short_formulas import fit_short_formulas
from glassgait.studies.distillation.students import STUDENTS, StudentSettings
from glassgait.studies.distillation.symbolic import fit_symbolic, fit_symbolic_per_state

FITS: dict[str, Callable[..., Policy]] = {
    "linear": fit_linear,
    "linear_per_state": fit_linear_per_state,
    **dict.fromkeys(("gbm", "histogram_gbm", "ebm"), fit_ensemble),
    "symbolic": fit_symbolic,
    "symbolic_per_state": fit_symbolic_per_state,
    "formulas": fit_short_formulas,
}
"""Fits a student: `fit(samples, settings, seed=seed)`."""

SHUFFLED_TEST_SHARE = 0.2  # share of the steps that the paper's split holds out


def write_r2_table(r2: pd.DataFrame, gait: str, folder: Path) -> pd.DataFrame:
    """Writes the scores, with the paper's, as metrics.json, r2.csv and r2.md."""
    table = pd.DataFrame(
        {
            "student": r2["student"],
            "R² (episodes held out)": r2["r2"].round(4),
            "R² (paper's shuffled split)": r2["r2_shuffled_split"].round(4),
            "paper": [STUDENTS[kind].paper_r2.get(gait, np.nan) for kind in r2["student"]],
            "worst joint": r2.filter(regex="^r2_.._").min(axis=1).round(4),
            **{title: r2[title] for title in READING_COST_TITLES},
        }
    )
    write_table(table, folder / "r2")
    # Without wall time, equal runs have equal metrics.
    metrics = r2.drop(columns="minutes").set_index("student").to_dict(orient="index")
    write_metrics(metrics, folder / "metrics.json")
    return table


def distill(
    config: DistillationConfig,
    gait: Gait,
    expert: Policy,
    folder: Path,
    *,
    resume: bool = False,
) -> pd.DataFrame:
    """Distils the expert into every student of the configuration, and returns a row of R² for each.

    Each round's samples and each finished student are written immediately, so that a resumed run
    has the same result as one that was never interrupted.
    """
    # The settings and inputs.
    config = config.for_gait(gait, symmetric=expert.symmetric)
    inputs = {"gait": gait.digest(), "expert": expert.digest()}
    worlds: DomainRandomization | Scenario = config.worlds
    if config.scenario is not None:
        worlds = load_scenario(config.scenario)
        inputs["scenario"] = worlds.digest()
    with open_run(
        folder,
        study="distill",
        settings=config,
        inputs=inputs,
        resume=resume,
        free=("students",),  # Students are independent of one another.
    ):
        work = _Distillation(config, gait, expert, worlds, folder)
        # Fit students that share samples in sequence, and others in parallel. The last kinds take
        # longest and therefore begin first.
        groups: dict[str, list[str]] = {}
        for kind in reversed(config.students):
            groups.setdefault(config.collector_of(kind), []).append(kind)
        if len(groups) == 1:
            # Joints are fitted in parallel instead.
            rows = work.students(config.students)
        else:
            calls = (delayed(work.students)(kinds) for kinds in groups.values())
            results = run_parallel(calls, in_order=False)
            rows = {kind: row for group in results for kind, row in group.items()}
        # Students need the expert's state estimator, even if the folder is moved.
        expert.save(policy_path(folder, EXPERT))
    return pd.DataFrame([rows[kind] for kind in config.students])


@dataclass(frozen=True)
class _Distillation:
    """Data that the students of a run share."""

    config: DistillationConfig
    gait: Gait
    expert: Policy
    worlds: DomainRandomization | Scenario
    folder: Path

    def students(self, kinds: Sequence[str]) -> dict[str, dict[str, Any]]:
        """Fits students, and returns their rows of the R² table."""
        return {kind: self._student(kind) for kind in kinds}

    def _student(self, kind: str) -> dict[str, Any]:
        """Collects samples for one student, fits and records it, or reads an existing record."""
        record_path = self.folder / kind / "record.json"
        if record_path.exists():
            row = read_record(record_path)
            path = policy_path(self.folder, kind)
            if not path.exists() or digest(path) != row["digest"]:
                raise InputError(
                    f"{path}: is not as the run wrote it; delete {record_path}, then --resume"
                )
        else:
            collector = self.config.collector_of(kind)
            if collector != kind:
                reason = "as --collector asks" if self.config.collector else "which is fitted fast"
                say(f"{kind}: takes the samples that {collector} collects, {reason}")
            # With one thread, sums are bitwise equal in every process.
            with threadpool_limits(1, user_api="blas"):
                dataset = self._collect(collector)
                started = time.monotonic()
                row = self._fit_final(kind, dataset)
            row["minutes"] = dataset.minutes + (time.monotonic() - started) / 60
            row["digest"] = digest(policy_path(self.folder, kind))
            write_record(record_path, row)
        say(f"{kind}: R² {row['r2']:.4f} on held-out episodes")
        return {key: value for key, value in row.items() if key != "digest"}

    def _collect(self, kind: str) -> Dataset:
        """Collects the samples of every round, or reads existing ones."""
        planned, dataset = rounds(self.config, kind), None
        for plan in planned:
            path = self.folder / kind / f"round_{plan.number:02d}.safetensors"
            if path.exists():
                samples = Dataset.load(path)
            else:
                samples = self._roll_out(kind, plan, len(planned), dataset)
                samples.save(path)
            dataset = samples if dataset is None else dataset.union(samples)
        assert dataset is not None
        return dataset

    def _roll_out(self, kind: str, plan: Round, n_rounds: int, before: Dataset | None) -> Dataset:
        """Fits the student to the samples so far, and rolls out a round with it."""
        started = time.monotonic()
        config = self.config

        # At a ratio of 1 only the expert acts, and the student need not be fitted.
        student = untrained_student(self.expert)
        if before is not None and plan.period != 1:
            fitted = before.subset(~before.held_out)
            say(f"{kind}: fitting to {len(fitted.actions)} samples")
            student = self._fit(kind, config.settings.of(kind).for_rounds(), self._samples(fitted))

        # Every round has a separate generator, so that it can be repeated.
        say(f"{kind}: round {plan.number} of {n_rounds}, ratio {ratio_title(plan.period)}")
        limit = self.gait.max_speed
        speeds = None if config.speeds is None else np.clip(config.speeds, -limit, limit)
        samples = collect(
            self.gait,
            Controller(self.expert, student, plan.period),
            episodes=plan.episodes,
            n_steps=plan.steps,
            speeds=speeds,
            worlds=self.worlds,
            generator=np.random.default_rng([config.seed, plan.number]),
        )
        return replace(samples, minutes=(time.monotonic() - started) / 60)

    def _fit_final(self, kind: str, dataset: Dataset) -> dict[str, Any]:
        """Fits the final student, saves it, and scores it on both splits."""
        fitted, held_out = dataset.subset(~dataset.held_out), dataset.subset(dataset.held_out)
        say(f"{kind}: fitting to {len(fitted.actions)} samples, the last time")
        settings, student = self._choose(kind, self._samples(fitted))

        # Score the student as it is saved; large files are rounded to single precision.
        student = student.compact().with_estimator_of(self.expert)
        student = student.with_joint_law(self.expert.joint_law)
        if isinstance(student, FormulaPolicy):
            names, observations = student.observation_names, fitted.observations
            ranges = readings_of(self.gait, student.robot, names, observations)
            student = student.with_readings(ranges).with_machine(self.gait)
            write_atomically(self.folder / f"{kind}.tex", to_latex(student.to_file()))
        student.save(self.folder / f"{kind}{student.suffix}")
        scores = r2_scores(student, held_out)

        # The paper's split shuffles the steps of its 30 episodes, so that neighbours of a held-out
        # step are in the training set.
        paper = dataset.subset(dataset.episodes <= self.config.episodes)
        index, share = np.arange(len(paper.episodes)), SHUFFLED_TEST_SHARE
        split = train_test_split(index, test_size=share, random_state=self.config.seed)
        train, test = (np.asarray(part) for part in split)
        samples = self._samples(paper).subset(train)
        shuffled = self._fit(kind, settings.for_shuffled_split(), samples)
        tested = paper.subset(np.isin(index, test))
        by_joint = zip(quadruped.JOINTS, scores, strict=True)
        return {
            "student": kind,
            "samples": len(fitted.actions),
            "held_out_samples": len(held_out.actions),
            "r2": float(scores.mean()),
            "r2_shuffled_split": float(r2_scores(shuffled, tested).mean()),
            **{f"r2_{joint}": float(r2) for joint, r2 in by_joint},
            **dict(zip(READING_COST_TITLES, reading_cost(student), strict=True)),
        }

    def _choose(self, kind: str, samples: TrainingSet) -> tuple[StudentSettings, Policy]:
        """Fits the student with all candidate settings, and selects the best by rollouts."""
        settings = self.config.settings.of(kind)
        candidates = settings.candidates()
        if len(candidates) <= 1:
            return settings, self._fit(kind, settings, samples)
        students = {
            title: self._fit(kind, candidate, samples)
            for title, (candidate, _) in candidates.items()
        }

        # Select by rollouts.
        say(f"{kind}: letting {len(candidates)} candidates walk, to choose one")
        ranked = rank_candidates(students, self.gait, self.expert, self.config.episode_steps)
        write_table(ranked, self.folder / f"{kind}_candidates")
        complexities = {title: complexity for title, (_, complexity) in candidates.items()}
        chosen = simplest_of_the_best(ranked, complexities)
        return candidates[chosen][0], students[chosen]

    def _samples(self, data: Dataset) -> TrainingSet:
        return data.training_set(self.gait, self.expert)

    def _fit(self, kind: str, settings: StudentSettings, samples: TrainingSet) -> Policy:
        weight = self.config.overdue_weight
        assert weight is not None  # `for_gait` has set it.
        return FITS[kind](samples.with_overdue(weight), settings, seed=self.config.seed)
