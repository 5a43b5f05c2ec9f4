"""`glassgait importance`: what each student looks at, and whether that is true."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
import tyro
import yaml

from models.a1 import robot
from models.a1.robot import Array
from models.errors import InputError
from models.files import write_atomically
from models.policies.library import load_expert
from models.policies.policy import Policy
from models.task.gait import load_gait
from studies.console import console, say
from studies.distillation.collection import Dataset, load_levels
from studies.distillation.study import load_students
from studies.evaluation.config import DISTILLED_SPEEDS, RolloutConfig
from studies.evaluation.jobs import run_jobs
from studies.evaluation.scores import interval
from studies.figures import save_figure
from studies.importance.figures import importance_map, loss_figure, truth_figure
from studies.importance.methods import METHOD_TITLES, own_importance, permutation_importance
from studies.importance.observations import merge_importances, observation_groups
from studies.importance.tables import PAPER_TOP, top_table
from studies.importance.truth import ablation_jobs, losses, rank_correlations
from studies.records import to_plain
from studies.tables import print_table, write_metrics, write_table


@dataclass(frozen=True)
class Importance:
    """Measure what each student looks at, and take it away to see whether that is true.

    Attributes:
        gait: Name of a gait.
        policies: Kinds of students.
        students: Folder of the distillation; runs/distillation/<gait> by default.
        n_samples: Held-out samples that importances are measured on, at most.
        repeats: Shuffles of each observation.
        rollouts: How robots are rolled out without observations; its seed is that of all shuffling.
        expert: Policy file of the expert; the shipped one by default.
        resume: Keep the rollouts that are done, where policies and settings are the same.
        output: Folder of the results; runs/importance/<gait> by default.
    """

    gait: str = "trot"
    policies: tuple[str, ...] = ("gbm", "ebm", "statewise_linear", "symbolic")
    students: Path | None = None
    n_samples: int = 1000
    repeats: int = 10
    rollouts: Annotated[RolloutConfig, tyro.conf.arg(name="")] = field(
        default_factory=lambda: RolloutConfig(
            n_robots=13, n_steps=500, n_seeds=1, speed_range=DISTILLED_SPEEDS
        )
    )
    expert: Path | None = None
    resume: bool = False
    output: Path | None = None

    def run(self) -> None:
        """Runs the study."""
        gait, expert = load_gait(self.gait), load_expert(self.gait, self.expert)
        source = self.students or Path("runs/distillation") / gait.name
        students = self._chosen(load_students(source, expert))
        folder = self.output or Path("runs/importance") / gait.name
        write_atomically(folder / "config.yaml", yaml.safe_dump(to_plain(self), sort_keys=False))
        names = expert.observation_names
        samples = {kind: self._samples(source / kind) for kind in students}
        importances = self._importances(students, samples, names, folder)
        means = np.mean([own.observations.mean(axis=0) for own in samples.values()], axis=0)
        say("rolling out without each group of observations")
        jobs = ablation_jobs(gait, expert, students, means, self.rollouts)
        lost = losses(run_jobs(jobs, folder / "rollouts", resume=self.resume))
        correlations = rank_correlations(importances, lost)
        for name, table in (("losses", lost), ("truth", correlations)):
            write_table(table, folder / name)
        save_figure(loss_figure(lost, gait.name), folder / "losses")
        save_figure(truth_figure(importances, lost, gait.name), folder / "truth")
        write_metrics(
            {
                "importances": importances.to_dict(orient="records"),
                "losses": lost.to_dict(orient="records"),
                "truth": correlations.to_dict(orient="records"),
            },
            folder / "metrics.json",
        )
        print_table(f"{gait.name}: rank correlation of importance and loss", correlations)
        console.print(f"written to {folder}")

    def _chosen(self, students: Mapping[str, Policy]) -> dict[str, Policy]:
        missing = [kind for kind in self.policies if kind not in students]
        if missing:
            raise InputError(
                f"no student {', '.join(missing)} of the {self.gait}; make it with "
                f"'glassgait distill --gait {self.gait}', or name others with --policies"
            )
        return {kind: students[kind] for kind in self.policies}

    def _samples(self, folder: Path) -> Dataset:
        data = load_levels(folder)
        held_out = np.flatnonzero(data.held_out)
        generator = np.random.default_rng(self.rollouts.seed)
        count = min(self.n_samples, len(held_out))
        chosen = generator.choice(held_out, count, replace=False)
        return data.subset(np.isin(np.arange(len(data.episodes)), chosen))

    def _importances(
        self,
        students: Mapping[str, Policy],
        samples: Mapping[str, Dataset],
        names: tuple[str, ...],
        folder: Path,
    ) -> pd.DataFrame:
        tables, tops = [], []
        for kind, student in students.items():
            say(f"shuffling the observations of {kind}")
            generator = np.random.default_rng([self.rollouts.seed, 1])
            shuffles = permutation_importance(student, samples[kind], generator, self.repeats)
            found = {"permutation": shuffles}
            own = own_importance(student, samples[kind].observations)
            if own is not None:
                found[own[0]] = own[1][None]
            for method, values in found.items():
                mean = values.mean(axis=0)
                stem = folder / f"{kind}_{method}"
                write_table(_by_joint(mean, names), stem)
                save_figure(importance_map(mean, names, METHOD_TITLES[method]), stem)
                tables.append(_by_group(values, names, kind, method))
                if method in PAPER_TOP:
                    top = top_table(mean, names, self.gait, method)
                    tops.append(top.assign(student=kind, method=method))
        write_table(pd.concat(tops, ignore_index=True), folder / "top_observations")
        return pd.concat(tables, ignore_index=True)


def _by_joint(importances: Array, names: tuple[str, ...]) -> pd.DataFrame:
    return pd.DataFrame(importances, columns=pd.Index(names)).assign(joint=robot.JOINTS)


def _by_group(values: Array, names: tuple[str, ...], policy: str, method: str) -> pd.DataFrame:
    """Adds importances (repeats, 12, n) up over each group, and averages over joints."""
    merged = merge_importances(values, names).mean(axis=1)
    return pd.DataFrame(
        {
            "policy": policy,
            "method": method,
            "without": list(observation_groups(names)),
            "importance": merged.mean(axis=0),
            "importance_ci": [interval(pd.Series(column)) for column in merged.T],
        }
    )
