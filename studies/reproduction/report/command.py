"""`glassgait reproduce report`: every table and figure of the paper, made anew."""

import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from glassgait.models.errors import InputError
from glassgait.models.files import write_atomically
from glassgait.models.policies.library import load_expert, shipped_experts
from glassgait.models.settings import DISTINCT, FEW, Settings
from glassgait.models.task.gait import gait_names
from glassgait.studies.common.console import console
from glassgait.studies.common.pages import inline_image, page_template
from glassgait.studies.common.run_folder import open_run
from glassgait.studies.common.sweep import ALL_GAITS, Gaits, Job, SweepConfig, run_sweep
from glassgait.studies.common.tables import print_table, to_markdown, write_table
from glassgait.studies.distillation.students.settings import StudentKind
from glassgait.studies.reproduction.report.certificates import (
    CertifiedPolicy,
    certified_policies,
    verdicts_table,
)
from glassgait.studies.reproduction.report.config import FULL, PAPER_GAITS, QUICK, ReportConfig
from glassgait.studies.reproduction.report.contents import DEVIATIONS, contents, r2_by_gait
from glassgait.studies.reproduction.report.gait import GaitResults, study_gait

TEMPLATES = Path(__file__).parent / "templates"


@dataclass(frozen=True)
class Report(Settings):
    """Distil, evaluate and explain the shipped experts, and write one report beside the paper.

    Attributes:
        gait: Names of gaits; `all` for every gait that ships.
        students: Kinds of students beside the paper's.
        quick: Fewer samples, smaller students, one seed.
        sweep: How many seeds of distillation, and where their gaits are studied.
        resume: Continue the run that the folder holds; it may name other gaits.
        output: Folder of the report; runs/report, or runs/report_quick, by default. Of several
            seeds each has a report in its folder seed_<seed>.
    """

    title: ClassVar[str] = "report"

    gait: Gaits = PAPER_GAITS
    students: Annotated[tuple[StudentKind, ...], FEW, DISTINCT] = ()
    quick: bool = False
    sweep: Annotated[SweepConfig, tyro.conf.arg(name="")] = field(default_factory=SweepConfig)
    resume: bool = False
    output: Path | None = None

    def run(self) -> None:
        """Runs every study, then writes report.html and report.md."""
        names = gait_names() if ALL_GAITS in self.gait else self.gait
        unknown = [name for name in names if name not in shipped_experts()]
        if unknown:
            raise InputError(
                f"no expert of {', '.join(unknown)} ships with the project; name some "
                f"of {', '.join(shipped_experts())} with --gait"
            )
        started = time.monotonic()
        inputs = {f"expert of the {name}": load_expert(name).digest() for name in names}
        configs = self._configs()
        with ExitStack() as runs:
            for folder, config in configs.items():
                run = {"study": "reproduce report", "inputs": inputs, "resume": self.resume}
                runs.enter_context(open_run(folder, settings=config, **run))
            results = self._study(names, configs)
            for folder, config in configs.items():
                certified = certified_policies([found.gait for found in results[folder]], folder)
                write_report(
                    results[folder],
                    config,
                    folder,
                    deviations=DEVIATIONS,
                    quick=self.quick,
                    certified=certified,
                )
                print_table("R²", r2_by_gait(results[folder]))
                console.print(f"report written to {folder / 'report.html'} and report.md")
        console.print(f"after {(time.monotonic() - started) / 60:.1f} minutes")

    def _study(
        self, names: Sequence[str], configs: Mapping[Path, ReportConfig]
    ) -> dict[Path, list[GaitResults]]:
        """Studies every gait for every report, and returns the results by the report's folder."""
        pairs = list(product(configs, names))
        if len(pairs) == 1 and self.sweep.backend == "loky":
            ((folder, name),) = pairs
            return {folder: [study_gait(name, configs[folder], folder / name, resume=self.resume)]}
        jobs = [
            Job(name, configs[folder].distillation.seed, folder / name, f"{folder}: {name}")
            for folder, name in pairs
        ]
        found = iter(run_sweep(jobs, partial(_study_job, configs), self.sweep))
        return {folder: [next(found) for _ in names] for folder in configs}

    def _configs(self) -> dict[Path, ReportConfig]:
        """Returns the settings of each seed's report by its folder."""
        config = self._config()
        root = self.output or Path("runs") / ("report_quick" if self.quick else "report")
        if self.sweep.seeds == 1:
            return {root: config}
        first = config.distillation.seed
        return {
            root / f"seed_{seed}": replace(
                config, distillation=replace(config.distillation, seed=seed)
            )
            for seed in range(first, first + self.sweep.seeds)
        }

    def _config(self) -> ReportConfig:
        config = QUICK if self.quick else FULL
        students = dict.fromkeys((*config.distillation.students, *self.students))
        return replace(config, distillation=replace(config.distillation, students=tuple(students)))


def write_report(
    results: Sequence[GaitResults],
    config: ReportConfig,
    folder: Path,
    *,
    deviations: Sequence[str],
    quick: bool,
    certified: Sequence[CertifiedPolicy] = (),
) -> None:
    """Writes report.html, report.md and the tables in them.

    Args:
        results: What was found about each gait.
        config: How thoroughly.
        folder: Where they go.
        deviations: Sentences that say what differs from the paper.
        quick: Whether a page says that it is for looking, not for quoting.
        certified: Policies that have a certificate.
    """
    items = contents(results)
    for item in items:
        for place, (_, table) in enumerate(item.tables, start=1):
            write_table(table, folder / f"{item.number.lower().replace(' ', '_')}_{place}")
    verdicts = verdicts_table(certified)
    if certified:
        write_table(verdicts, folder / "certificates")
    for place, policy in enumerate(certified, start=1):
        write_table(policy.claims, folder / f"certificates_{place}")
    values = {
        "items": items,
        "certified": certified,
        "verdicts": verdicts,
        "deviations": deviations,
        "gaits": [found.gait for found in results],
        "config": config,
        "quick": quick,
    }
    page = page_template(TEMPLATES, "report.html").render(**values, inline=inline_image)
    write_atomically(folder / "report.html", page)
    text = page_template(TEMPLATES, "report.md").render(
        **values, markdown=to_markdown, place=lambda path: _relative(path, folder)
    )
    write_atomically(folder / "report.md", text)


def _study_job(configs: Mapping[Path, ReportConfig], job: Job) -> GaitResults:
    return study_gait(job.gait, configs[job.folder.parent], job.folder, resume=True)


def _relative(path: Path, folder: Path) -> str:
    resolved, root = path.resolve(), folder.resolve()
    return str(resolved.relative_to(root) if resolved.is_relative_to(root) else resolved)
