"""`glassgait report`: every table and figure of the paper, made anew."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, ClassVar

from annotated_types import MinLen

from glassgait.models.errors import InputError
from glassgait.models.files import write_atomically
from glassgait.models.policies.library import load_expert, shipped_experts
from glassgait.models.settings import DISTINCT, FEW, Settings
from glassgait.studies.console import console, say
from glassgait.studies.pages import inline_image, page_template
from glassgait.studies.report.config import FULL, PAPER_GAITS, QUICK, ReportConfig
from glassgait.studies.report.contents import DEVIATIONS, contents, r2_by_gait
from glassgait.studies.report.gait import GaitResults, study_gait
from glassgait.studies.run_folder import open_run
from glassgait.studies.students.settings import StudentKind
from glassgait.studies.tables import print_table, to_markdown, write_table

TEMPLATES = Path(__file__).parent / "templates"


@dataclass(frozen=True)
class Report(Settings):
    """Distil, evaluate and explain the shipped experts, and write one report beside the paper.

    Attributes:
        gaits: Names of gaits.
        students: Kinds of students beside the paper's.
        quick: Fewer samples, smaller students, one seed.
        resume: Continue the run that the folder holds; it may name other gaits.
        output: Folder of the report; runs/report, or runs/report_quick, by default.
    """

    title: ClassVar[str] = "report"

    gaits: Annotated[tuple[str, ...], MinLen(1), FEW, DISTINCT] = PAPER_GAITS
    students: Annotated[tuple[StudentKind, ...], FEW, DISTINCT] = ()
    quick: bool = False
    resume: bool = False
    output: Path | None = None

    def run(self) -> None:
        """Runs every study, then writes report.html and report.md."""
        unknown = [gait for gait in self.gaits if gait not in shipped_experts()]
        if unknown or not self.gaits:
            raise InputError(
                f"no expert of {', '.join(unknown) or 'no gait'} ships with the project; name some "
                f"of {', '.join(shipped_experts())} with --gaits"
            )
        started = time.monotonic()
        config = self._config()
        folder = self.output or Path("runs") / ("report_quick" if self.quick else "report")
        experts = {gait: load_expert(gait) for gait in self.gaits}
        with open_run(
            folder,
            study="report",
            settings=config,
            inputs={f"expert of the {gait}": own.digest() for gait, own in experts.items()},
            resume=self.resume,
        ):
            results = []
            for place, gait in enumerate(self.gaits, start=1):
                say(f"{gait}, gait {place} of {len(self.gaits)}")
                results.append(study_gait(gait, config, folder / gait, resume=self.resume))
            self._write(results, config, folder)
        print_table("R²", r2_by_gait(results))
        minutes = (time.monotonic() - started) / 60
        console.print(
            f"report written to {folder / 'report.html'} and report.md after {minutes:.1f} minutes"
        )

    def _config(self) -> ReportConfig:
        config = QUICK if self.quick else FULL
        students = dict.fromkeys((*config.distillation.students, *self.students))
        return replace(config, distillation=replace(config.distillation, students=tuple(students)))

    def _write(self, results: Sequence[GaitResults], config: ReportConfig, folder: Path) -> None:
        items = contents(results)
        for item in items:
            for place, (_, table) in enumerate(item.tables, start=1):
                write_table(table, folder / f"{item.number.lower().replace(' ', '_')}_{place}")
        values = {
            "items": items,
            "deviations": DEVIATIONS,
            "gaits": self.gaits,
            "config": config,
            "quick": self.quick,
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
