"""The distillation study: Algorithm 1 of the paper for each student, one round at a time."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

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
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.policies.library import POLICY_CLASSES, policy_path, save_policy
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.task.alternation import ratio_title
from glassgait.models.task.gait import Gait
from glassgait.studies.common.parallel.loop import run_parallel, runs_here
from glassgait.studies.common.policies import EXPERT
from glassgait.studies.common.run_folder import open_run
from glassgait.studies.common.selection import rank_alone, simplest_of_the_best
from glassgait.studies.common.tables import write_metrics, write_table
from glassgait.studies.distillation.collection import collect
from glassgait.studies.distillation.config import DistillationConfig, Round, rounds
from glassgait.studies.distillation.students.baselines import untrained_student
from glassgait.studies.distillation.students.dataset import Dataset, r2_scores
from glassgait.studies.distillation.students.registry import STUDENTS, student_title
from glassgait.studies.distillation.students.student import Student, StudentSettings, TrainingSet
from glassgait.studies.distillation.students.symbolic import readings_of


def r2_table(r2: pd.DataFrame, gait: str) -> pd.DataFrame:
    """Formats the scores for reading, the paper's beside ours."""
    paper = [STUDENTS[kind].paper_r2.get(gait, float("nan")) for kind in r2["student"]]
    return pd.DataFrame(
        {
            "student": [student_title(kind) for kind in r2["student"]],
            "R² (episodes held out)": r2["r2"].round(4),
            "R² (paper's shuffled split)": r2["r2_shuffled_split"].round(4),
            "paper": paper,
            "worst joint": r2.filter(regex="^r2_.._").min(axis=1).round(4),
        }
    )


def write_r2_table(r2: pd.DataFrame, gait: str, folder: Path) -> pd.DataFrame:
    """Writes the scores as metrics.json, r2.csv and r2.md, and returns the table."""
    table = r2_table(r2, gait)
    write_table(table, folder / "r2")
    # Wall time is left out: equal runs give equal metrics.
    metrics = r2.drop(columns="minutes").set_index("student").to_dict(orient="index")
    write_metrics(metrics, folder / "metrics.json")
    return table


SHUFFLED_TEST_SHARE = 0.2

Report = Callable[[str], None]


def _leave(_: pd.DataFrame) -> None:
    """Does nothing with the table so far."""


def distill(
    config: DistillationConfig,
    gait: Gait,
    expert: NeuralPolicy,
    folder: Path,
    report: Report,
    *,
    resume: bool = False,
    finished: Callable[[pd.DataFrame], None] = _leave,
) -> pd.DataFrame:
    """Distils the expert into every student of the configuration.

    Each round's samples and each finished student are written at once, and every round draws from
    a generator of its own: a run that was killed and resumed ends as if it had not been.

    Args:
        config: Settings.
        folder: Where the run is kept.
        report: Called with a line of progress.
        resume: Whether to continue the run that the folder holds.
        finished: Called with the R² table so far, after each student.

    Returns:
        The R² table: a row a student.

    Raises:
        InputError: if the folder cannot be claimed for this run (see `open_run`), or holds a file
            that is damaged; or a student's file does not act as the student.
    """
    config = config.for_gait(gait)
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
        free=("students", "n_workers"),  # Students are independent of one another.
    ) as run:
        work = _Distillation(config, gait, expert, worlds, folder, run, report)
        rows: dict[str, dict] = {}
        for kind, row in work.rows():
            if not rows:
                # Students observe by its estimator, wherever the folder is moved.
                expert.save(policy_path(folder, EXPERT))
            rows[kind] = row
            table = pd.DataFrame([rows[kind] for kind in config.students if kind in rows])
            finished(table)
        return table


@dataclass(frozen=True)
class _Distillation:
    """One run: what all of its students share."""

    config: DistillationConfig
    gait: Gait
    expert: NeuralPolicy
    worlds: DomainRandomization | Scenario
    folder: Path
    run: str
    report: Report

    def rows(self) -> Iterator[tuple[str, dict]]:
        """Makes the students and yields what is known of each.

        Those that share samples are made in one process, one after the other. On this machine
        different processes make the others at once; on a cluster, whose nodes need not see the
        folder, the joints of one student after the other are fitted at once.
        """
        jobs = self._jobs()
        if len(jobs) == 1 or not runs_here():
            for kind in self.config.students:
                yield kind, self.student(kind)
            return
        registries = dict(STUDENTS), dict(POLICY_CLASSES)
        calls = (delayed(_make)(self, kinds, *registries) for kinds in jobs)
        for rows in run_parallel(calls, self.config.n_workers, in_order=False, ahead=1):
            yield from rows.items()

    def _jobs(self) -> list[list[str]]:
        """Groups the students by the one that collects their samples.

        The last come first: in the registry they stand behind what is quick, and what takes long
        had better not be begun last.
        """
        groups: dict[str, list[str]] = {}
        for kind in reversed(self.config.students):
            groups.setdefault(self.config.collector_of(kind), []).append(kind)
        return list(groups.values())

    def student(self, kind: str) -> dict:
        """Collects, fits and records one student, or reads its record if that is done."""
        record_path = self.folder / kind / "record.json"
        if record_path.exists():
            row = read_record(record_path, of=f"{self.run} {kind}")
            path = policy_path(self.folder, kind)
            if not path.exists() or digest(path) != row["digest"]:
                raise InputError(
                    f"{path}: is not what the run wrote; delete {record_path}, and --resume makes "
                    "it anew"
                )
        else:
            # With one thread each, sums have the same last bits in whatever process they are made.
            with threadpool_limits(1, user_api="blas"):
                dataset = self._collect(self.config.collector_of(kind))
                started = time.monotonic()
                row = self._fit_final(kind, dataset)
            row["minutes"] = dataset.minutes + (time.monotonic() - started) / 60
            row["digest"] = digest(policy_path(self.folder, kind))
            write_record(record_path, row, of=f"{self.run} {kind}")
        self.report(f"{STUDENTS[kind].title}: R² {row['r2']:.4f} on held-out episodes")
        return {key: value for key, value in row.items() if key != "digest"}

    def _collect(self, kind: str) -> Dataset:
        """Collects the samples of every round, or reads those that are there."""
        folder, planned = self.folder / kind, rounds(self.config, kind)
        dataset = None
        for plan in planned:
            path = folder / f"round_{plan.number:02d}.safetensors"
            of = f"{self.run} {kind} round {plan.number}"
            if path.exists():
                samples = Dataset.load(path, of=of)
            else:
                samples = self._roll_out(kind, plan, len(planned), dataset)
                samples.save(path, of=of)
            dataset = samples if dataset is None else dataset.union(samples)
        assert dataset is not None
        return dataset

    def _roll_out(self, kind: str, plan: Round, n_rounds: int, before: Dataset | None) -> Dataset:
        """Fits the student to the samples so far, and rolls a round out with it."""
        started = time.monotonic()
        config, title = self.config, STUDENTS[kind].title
        student = untrained_student(self.expert)
        if before is not None and plan.period != 1:
            seen = before.subset(~before.held_out)
            self.report(f"{title}: fitting to {len(seen.actions)} samples")
            settings = config.settings.of(kind).for_rounds()
            student = self._fit(kind, settings, self._samples(seen))
        ratio, speeds = ratio_title(plan.period), config.speeds
        self.report(f"{title}: round {plan.number} of {n_rounds}, ratio {ratio}")
        controller = AlternatingController(self.expert, student, plan.period)
        samples = collect(
            self.gait,
            controller,
            episodes=plan.episodes,
            n_steps=plan.steps,
            speeds=None if speeds is None else np.minimum(speeds, self.gait.max_speed),
            worlds=self.worlds,
            generator=np.random.default_rng([config.seed, plan.number]),
        )
        return replace(samples, minutes=(time.monotonic() - started) / 60)

    def _fit_final(self, kind: str, dataset: Dataset) -> dict:
        """Fits the student the last time, saves it, and scores it by both splits."""
        seen, held_out = dataset.subset(~dataset.held_out), dataset.subset(dataset.held_out)
        title = STUDENTS[kind].title
        self.report(f"{title}: fitting to {len(seen.actions)} samples, the last time")
        settings, student = self._choose(kind, self._samples(seen))
        # What is scored is what is saved, rounded to single precision where that halves a file.
        student = student.compact().with_estimator_of(self.expert)
        student = student.with_joint_law(self.expert.joint_law)
        if isinstance(student, FormulaPolicy):
            names, observations = student.observation_names, seen.observations
            ranges = readings_of(self.gait, student.robot, names, observations)
            student = student.with_readings(ranges).with_machine(self.gait)
        save_policy(student, self.folder / f"{kind}{student.suffix}", held_out.observations)
        if isinstance(student, FormulaPolicy):
            write_atomically(
                self.folder / f"{kind}.tex", to_latex(student.to_file(), student.robot)
            )
        scores = r2_scores(student, held_out)

        # The paper's split shuffles the steps of its 30 episodes: neighbours of a held-out step are
        # then in the fit.
        paper = dataset.subset(dataset.episodes <= self.config.episodes)
        index, share = np.arange(len(paper.episodes)), SHUFFLED_TEST_SHARE
        split = train_test_split(index, test_size=share, random_state=self.config.seed)
        train, test = (np.asarray(part) for part in split)
        samples = self._samples(paper).subset(train)
        shuffled = self._fit(kind, settings.for_shuffled_split(), samples)
        tested = paper.subset(np.isin(index, test))
        return {
            "student": kind,
            "samples": len(seen.actions),
            "held_out_samples": len(held_out.actions),
            "r2": float(scores.mean()),
            "r2_shuffled_split": float(r2_scores(shuffled, tested).mean()),
            **{
                f"r2_{joint}": float(r2) for joint, r2 in zip(quadruped.JOINTS, scores, strict=True)
            },
        }

    def _choose(self, kind: str, samples: TrainingSet) -> tuple[StudentSettings, Policy]:
        """Fits the student; where its settings leave a choice, all, and the robots choose."""
        settings = self.config.settings.of(kind)
        candidates = {candidate.title: candidate for candidate in settings.candidates()}
        if len(candidates) <= 1:
            return settings, self._fit(kind, settings, samples)
        students = {
            title: self._fit(kind, candidate.settings, samples)
            for title, candidate in candidates.items()
        }
        title, config = STUDENTS[kind].title, self.config
        self.report(f"{title}: letting {len(candidates)} candidates walk alone, to choose one")
        ranked = rank_alone(
            students, self.gait, self.expert, config.episode_steps, config.n_workers
        )
        write_table(ranked, self.folder / f"{kind}_candidates")
        complexities = {title: candidate.complexity for title, candidate in candidates.items()}
        chosen = simplest_of_the_best(ranked, complexities)
        return candidates[chosen].settings, students[chosen]

    def _samples(self, data: Dataset) -> TrainingSet:
        return data.training_set(self.gait, self.expert)

    def _fit(self, kind: str, settings: StudentSettings, samples: TrainingSet) -> Policy:
        config = self.config
        assert config.overdue_weight is not None  # `for_gait` has set it.
        counted = samples.with_overdue(config.overdue_weight)
        return STUDENTS[kind].fit(counted, settings, seed=config.seed, n_jobs=config.n_workers)


def _make(
    work: _Distillation,
    kinds: Sequence[str],
    students: Mapping[str, Student],
    policies: Mapping[str, type[Policy]],
) -> dict:
    """Makes students in another process, whose registries have no entries made at run time."""
    STUDENTS.update(students)
    POLICY_CLASSES.update(policies)
    return {kind: work.student(kind) for kind in kinds}
