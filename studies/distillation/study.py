"""The distillation study: Algorithm 1 of the paper for each student, one level at a time."""

import time
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from sklearn.model_selection import train_test_split

from glassgait.diagrams.scenario import load_scenario
from glassgait.models.a1 import robot
from glassgait.models.a1.robot import Array
from glassgait.models.errors import InputError
from glassgait.models.files import digest, read_record, write_record
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.task.alternation import ratio_title
from glassgait.models.task.gait import Gait
from glassgait.studies.distillation.collection import Dataset, collect
from glassgait.studies.distillation.config import (
    FORMULAS,
    STUDENT_TITLES,
    DistillationConfig,
    Shape,
    StudentKind,
)
from glassgait.studies.distillation.formulas import write_formulas
from glassgait.studies.distillation.library import collector, samples_folder, student_path
from glassgait.studies.distillation.selection import rank_alone, simplest_of_the_best
from glassgait.studies.distillation.students import fit_student, untrained_student
from glassgait.studies.run_folder import open_run
from glassgait.studies.tables import write_table

SHUFFLED_TEST_SHARE = 0.2

Report = Callable[[str], None]


def distill(
    config: DistillationConfig,
    gait: Gait,
    expert: NeuralPolicy,
    folder: Path,
    report: Report,
    *,
    resume: bool = False,
) -> pd.DataFrame:
    """Distils the expert into every student of the configuration.

    Each level's samples and each finished student are written at once, and every level draws from
    a generator of its own: a run that was killed and resumed ends as if it had not been.

    Args:
        config: Settings.
        gait: The gait that they name.
        expert: The expert.
        folder: Where the run is kept.
        report: Called with a line of progress.
        resume: Whether to continue the run that the folder holds.

    Returns:
        The R² table: a row a student.

    Raises:
        InputError: if the folder cannot be claimed for this run (see `open_run`), or holds a file
            that is damaged.
    """
    config = config.for_gait(gait)
    scenario = load_scenario(config.scenario)
    inputs = {"gait": gait.digest(), "expert": expert.digest(), "scenario": scenario.digest()}
    with open_run(
        folder,
        study="distill",
        settings=config,
        inputs=inputs,
        resume=resume,
        free=("students", "n_jobs"),  # Students are independent of one another.
    ) as run:
        rows = [
            _distill_student(kind, config, gait, expert, folder, run, report)
            for kind in config.students
        ]
    return pd.DataFrame(rows)


def _distill_student(
    kind: StudentKind,
    config: DistillationConfig,
    gait: Gait,
    expert: NeuralPolicy,
    folder: Path,
    run: str,
    report: Report,
) -> dict:
    """Collects, fits and records one student, or reads its record if that is done."""
    path, record_path = student_path(folder, kind), folder / kind / "record.json"
    if record_path.exists():
        row = read_record(record_path, of=f"{run} {kind}")
        if not path.exists() or digest(path) != row["digest"]:
            raise InputError(
                f"{path}: is not what the run wrote; delete {record_path}, and --resume makes it "
                "anew"
            )
    else:
        samples = samples_folder(folder, kind)
        dataset = _collect_levels(collector(kind), config, gait, expert, samples, run, report)
        started = time.monotonic()
        row = _fit_final(kind, config, gait, expert, dataset, folder, report)
        row["minutes"] = dataset.minutes + (time.monotonic() - started) / 60
        row["digest"] = digest(path)
        write_record(record_path, row, of=f"{run} {kind}")
    report(f"{STUDENT_TITLES[kind]}: R² {row['r2']:.4f} on held-out episodes")
    return {key: value for key, value in row.items() if key != "digest"}


def r2_scores(policy: Policy, dataset: Dataset) -> Array:
    """Returns the coefficient of determination of each joint (12,)."""
    error = np.square(dataset.actions - policy(dataset.observations)).sum(axis=0)
    spread = np.square(dataset.actions - dataset.actions.mean(axis=0)).sum(axis=0)
    return 1.0 - error / spread


def _collect_levels(
    kind: StudentKind,
    config: DistillationConfig,
    gait: Gait,
    expert: NeuralPolicy,
    folder: Path,
    run: str,
    report: Report,
) -> Dataset:
    speeds = np.minimum(config.speeds, gait.max_speed)
    dataset = None
    student = untrained_student(gait.name, expert.observation_names)
    for level in range(1, config.n_levels + 1):
        path = folder / f"level_{level:02d}.safetensors"
        of = f"{run} {kind} level {level}"
        if path.exists():
            samples = Dataset.load(path, of=of)
        else:
            started = time.monotonic()
            period = config.period(level)
            if dataset is not None and period != 1:
                seen = dataset.subset(~dataset.held_out)
                report(f"{STUDENT_TITLES[kind]}: fitting to {len(seen.actions)} samples")
                student = _fit(kind, config.for_levels(), expert, seen)
            mine = np.array(config.level_episodes(level, kind))
            ratio = ratio_title(period)
            report(f"{STUDENT_TITLES[kind]}: level {level} of {config.n_levels}, ratio {ratio}")
            samples = collect(
                gait,
                expert,
                student,
                period=period,
                episodes=mine,
                speeds=speeds[(mine - 1) % len(speeds)],
                n_steps=config.level_steps(level, kind),
                scenario=load_scenario(config.scenario),
                generator=np.random.default_rng([config.seed, level]),
            )
            samples = replace(samples, minutes=(time.monotonic() - started) / 60)
            samples.save(path, of=of)
        dataset = samples if dataset is None else dataset.union(samples)
    assert dataset is not None
    return dataset


def _fit_final(
    kind: StudentKind,
    config: DistillationConfig,
    gait: Gait,
    expert: NeuralPolicy,
    dataset: Dataset,
    folder: Path,
    report: Report,
) -> dict:
    seen, held_out = dataset.subset(~dataset.held_out), dataset.subset(dataset.held_out)
    report(f"{STUDENT_TITLES[kind]}: fitting to {len(seen.actions)} samples, the last time")
    final, student = _choose_final(kind, config, gait, expert, seen, folder, report)
    if config.compact:
        student = student.compact()
    student.save(student_path(folder, kind))
    if isinstance(student, FormulaPolicy):
        write_formulas(student, folder / f"{kind}_formulas")
    scores = r2_scores(student, held_out)

    # The paper's split shuffles steps: neighbours of a held-out step are then in the fit.
    index = np.arange(len(dataset.episodes))
    train, test = train_test_split(index, test_size=SHUFFLED_TEST_SHARE, random_state=config.seed)
    shuffled = _fit(kind, final.for_shuffled_split(), expert, dataset, train)
    mask = np.isin(index, test)
    return {
        "student": kind,
        "samples": len(seen.actions),
        "held_out_samples": len(held_out.actions),
        "r2": float(scores.mean()),
        "r2_shuffled_split": float(r2_scores(shuffled, dataset.subset(mask)).mean()),
        **{f"r2_{joint}": float(r2) for joint, r2 in zip(robot.JOINTS, scores, strict=True)},
    }


def _choose_final(
    kind: StudentKind,
    config: DistillationConfig,
    gait: Gait,
    expert: NeuralPolicy,
    seen: Dataset,
    folder: Path,
    report: Report,
) -> tuple[DistillationConfig, Policy]:
    """Fits the student; of formulas one of each shape and start weight, to choose from."""
    pairs = product(config.symbolic.shapes_of(kind), config.symbolic.start_weights)
    choices = {_title(*pair): pair for pair in pairs}
    if kind not in FORMULAS or config.symbolic.engine == "pysr" or len(choices) == 1:
        return config, _fit(kind, config, expert, seen)
    settings = {
        title: replace(config, symbolic=config.symbolic.only(*pair))
        for title, pair in choices.items()
    }
    candidates = {title: _fit(kind, own, expert, seen) for title, own in settings.items()}
    report(
        f"{STUDENT_TITLES[kind]}: letting {len(candidates)} candidates walk alone, to choose one"
    )
    ranked = rank_alone(candidates, gait, expert, config.episode_steps, config.n_jobs)
    write_table(ranked, folder / f"{kind}_candidates")
    complexities = {title: _complexity(shape) for title, (shape, _) in choices.items()}
    chosen = simplest_of_the_best(ranked, complexities)
    return settings[chosen], candidates[chosen]


def _fit(
    kind: StudentKind,
    config: DistillationConfig,
    expert: NeuralPolicy,
    dataset: Dataset,
    index: NDArray[np.int64] | None = None,
) -> Policy:
    """Fits a student to all samples, or to those of an index; formulas may count starts often."""
    chosen = np.arange(len(dataset.actions)) if index is None else index
    if kind in FORMULAS:
        counts = np.where(dataset.starts, config.symbolic.start_weights[0], 1)
        chosen = np.repeat(chosen, counts[chosen])
    observations, actions = dataset.observations[chosen], dataset.actions[chosen]
    return fit_student(kind, config, expert.gait, expert.observation_names, observations, actions)


def _complexity(shape: Shape) -> tuple[int, int]:
    # Of equal length, a longer sum leaves less to the engine, whose terms are harder to read.
    sum_length, length = shape
    return length, -sum_length


def _title(shape: Shape, start_weight: int) -> str:
    sum_length, length = shape
    title = f"sum of {sum_length}, {length} in all"
    return title if start_weight == 1 else f"{title}, starts count {start_weight}"
