"""`glassgait reproduce report` and `reproduce paper`: the paper's tables and figures, made anew."""

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
from glassgait.models.settings import DISTINCT, FEW
from glassgait.models.task.gait import load_gait
from glassgait.studies.common.console import console, say
from glassgait.studies.common.pages import inline_image, page_template
from glassgait.studies.common.run_folder import open_run
from glassgait.studies.common.sweep import Gaits, Job, SweepConfig, gaits_named, run_sweep
from glassgait.studies.common.tables import print_table, to_markdown, write_table
from glassgait.studies.distillation.students.registry import StudentKind
from glassgait.studies.distillation.students.symbolic import SYMBOLIC
from glassgait.studies.distillation.students.symbolic_regression import Engine, pysr_starts
from glassgait.studies.reproduction.certificates import (
    CertifiedPolicy,
    certified_policies,
    verdicts_table,
)
from glassgait.studies.reproduction.contents import (
    DEVIATIONS,
    DEVIATIONS_IN_FULL,
    WITHOUT_PYSR,
    contents,
    r2_by_gait,
)
from glassgait.studies.reproduction.gait import PAPER_GAITS, GaitResults, ReportConfig, study_gait
from glassgait.studies.reproduction.settings import differences, load_settings, settings_file
from glassgait.studies.training.command import train_job
from glassgait.studies.training.config import TrainingConfig

TEMPLATES = Path(__file__).parent / "templates"


@dataclass(frozen=True)
class Report(ReportConfig):
    """Distil, evaluate and explain experts, and write one report beside the paper.

    The settings stand in studies/reproduction/report.yaml, which takes the experts that ship, and
    in paper.yaml, the paper's own, which trains them: that takes days, of which --resume loses
    minutes. --quick does less of everything, to see that all runs.

    Attributes:
        gait: Names of gaits; `all` for every gait that ships.
        training: How experts learn, the gait set for each; by default those that ship are taken.
        policy: Kinds of students beside the paper's.
        engine: What searches the formulas, in place of the settings' engine. PySR, the paper's,
            needs Julia and is refused where there is none; with `operon` the report says so.
        quick: Do what the settings file names under `quick` instead.
        sweep: How many seeds of distillation, and where their gaits are studied.
        resume: Continue the run that the folder holds; it may name other gaits.
        output: Folder of the report. Of several seeds each has a report in its folder seed_<seed>.
    """

    title: ClassVar[str] = "report"

    gait: Gaits = PAPER_GAITS
    training: Annotated[TrainingConfig | None, tyro.conf.Fixed] = None
    policy: Annotated[tuple[StudentKind, ...], FEW, DISTINCT] = ()
    engine: Engine | None = None
    quick: bool = False
    sweep: Annotated[SweepConfig, tyro.conf.arg(name="")] = field(default_factory=SweepConfig)
    resume: bool = False
    output: Path | None = None

    @property
    def study(self) -> str:
        """What a run's record calls the study."""
        return "reproduce report" if self.training is None else "reproduce paper"

    def run(self) -> None:
        """Runs every study, then writes report.html and report.md."""
        names = gaits_named(self.gait)
        inputs = self._inputs(names)
        started = time.monotonic()
        reports = self._reports()
        with ExitStack() as runs:
            for folder, own in reports.items():
                of = {"study": self.study, "inputs": inputs, "resume": self.resume}
                runs.enter_context(open_run(folder, settings=own, free=("gait",), **of))
            results = _study(names, reports)
            for folder, own in reports.items():
                certified = () if self.training else certified_policies(names, folder)
                write_report(
                    results[folder],
                    own,
                    folder,
                    deviations=own.deviations(folder),
                    quick=self.quick,
                    certified=certified,
                )
                print_table("R²", r2_by_gait(results[folder]))
                console.print(f"report written to {folder / 'report.html'} and report.md")
        console.print(f"after {(time.monotonic() - started) / 60:.1f} minutes")

    def deviations(self, folder: Path) -> tuple[str, ...]:
        """Lists what differs from the paper: by nature and, where all is done anew, by settings.

        Differences in settings are printed, and written to the folder.
        """
        if self.training is None:
            return DEVIATIONS
        less = differences(load_settings(Report, settings_file("paper")), self)
        write_table(less, folder / "differences")
        if len(less):
            print_table("Not as in paper.yaml", less)
        here = [
            f"{row['setting']}: {row['here']}, not {row['in full']}." for _, row in less.iterrows()
        ]
        engine = (WITHOUT_PYSR,) if self._searches_by() == "operon" else ()
        return (*here, *engine, *DEVIATIONS_IN_FULL)

    def settled(self) -> "Report":
        """Returns the settings with the engine and the further students that flags name.

        Raises:
            InputError: if formulas are PySR's, and Julia could not be started.
        """
        own = self.distillation
        students = tuple(dict.fromkeys((*own.students, *self.policy)))
        settings = own.settings
        if self.engine is not None:
            symbolic = replace(settings.of(SYMBOLIC.name), engine=self.engine)
            settings = replace(settings, **{SYMBOLIC.name: symbolic})
        distillation = replace(own, students=students, settings=settings)
        report = replace(self, distillation=distillation, policy=(), engine=None)
        if report._searches_by() == "pysr" and not pysr_starts():
            raise InputError(
                "report: formulas are PySR's, which needs Julia, and Julia could not be started "
                "here; install it, or take Operon in place of PySR with --engine operon"
            )
        return report

    def _searches_by(self) -> str | None:
        """Returns what searches the formulas; None where there are none."""
        settings = self.distillation.settings.of(SYMBOLIC.name)
        return vars(settings)["engine"] if SYMBOLIC.name in self.distillation.students else None

    def _inputs(self, names: Sequence[str]) -> dict[str, str]:
        if self.training is not None:
            return {f"gait {name}": load_gait(name).digest() for name in names}
        unknown = [name for name in names if load_gait(name).name not in shipped_experts()]
        if unknown:
            raise InputError(
                f"no expert of {', '.join(unknown)} ships with the project; name some "
                f"of {', '.join(shipped_experts())} with --gait"
            )
        return {f"expert of the {name}": load_expert(name).digest() for name in names}

    def _reports(self) -> dict[Path, "Report"]:
        """Returns the settings of each seed's report by its folder."""
        report, root = self.settled(), self.output or Path("runs/report")
        if self.sweep.seeds == 1:
            return {root: report}
        own = report.distillation
        return {
            root / f"seed_{seed}": replace(report, distillation=replace(own, seed=seed))
            for seed in range(own.seed, own.seed + self.sweep.seeds)
        }


def _study(names: Sequence[str], reports: Mapping[Path, Report]) -> dict[Path, list[GaitResults]]:
    """Studies every gait for every report, and returns the results by the report's folder."""
    jobs = [
        Job(
            name,
            reports[folder].distillation.seed,
            folder / load_gait(name).name,
            f"{folder}: {name}",
        )
        for folder, name in product(reports, names)
    ]
    sweep = next(iter(reports.values())).sweep
    if len(jobs) == 1 and sweep.backend == "loky":
        found = iter([_study_job(reports, jobs[0])])
    else:
        found = iter(run_sweep(jobs, partial(_study_job, reports), sweep))
    return {folder: [next(found) for _ in names] for folder in reports}


def _study_job(reports: Mapping[Path, Report], job: Job) -> GaitResults:
    """Trains the expert of a gait, if it is to be, and studies it, from where the job stopped."""
    report = reports[job.folder.parent]
    expert = None
    if report.training is not None:
        training = Job(job.gait, report.training.seed, job.folder / "training", job.title)
        say(f"{job.title}: training the expert")
        train_job(report.training, training)
        expert = training.folder / f"{load_gait(job.gait).name}.safetensors"
    return study_gait(job.gait, report, job.folder, resume=True, expert_file=expert)


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


def _relative(path: Path, folder: Path) -> str:
    resolved, root = path.resolve(), folder.resolve()
    return str(resolved.relative_to(root) if resolved.is_relative_to(root) else resolved)
