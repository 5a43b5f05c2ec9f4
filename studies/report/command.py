"""`glassgait report`: every table and figure of the paper, made anew."""

import time
from dataclasses import dataclass
from pathlib import Path

import yaml

from models.errors import InputError
from models.files import write_atomically
from models.policies.library import shipped_experts
from studies.console import console, say
from studies.pages import inline_image, page_template
from studies.records import to_plain
from studies.report.config import FULL, PAPER_GAITS, QUICK
from studies.report.contents import DEVIATIONS, contents, r2_by_gait
from studies.report.gait import study_gait
from studies.tables import print_table, to_markdown, write_table

TEMPLATES = Path(__file__).parent / "templates"


@dataclass(frozen=True)
class Report:
    """Distil, evaluate and explain the shipped experts, and write one report beside the paper.

    Attributes:
        gaits: Names of gaits.
        quick: Fewer samples, smaller students, one seed.
        resume: Keep what an interrupted run has finished.
        output: Folder of the report; runs/report, or runs/report_quick, by default.
    """

    gaits: tuple[str, ...] = PAPER_GAITS
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
        config = QUICK if self.quick else FULL
        folder = self.output or Path("runs") / ("report_quick" if self.quick else "report")
        results = []
        for place, gait in enumerate(self.gaits, start=1):
            say(f"{gait}, gait {place} of {len(self.gaits)}")
            results.append(study_gait(gait, config, folder / gait, resume=self.resume))
        write_atomically(folder / "config.yaml", yaml.safe_dump(to_plain(config), sort_keys=False))
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
        print_table("R²", r2_by_gait(results))
        minutes = (time.monotonic() - started) / 60
        console.print(
            f"report written to {folder / 'report.html'} and report.md after {minutes:.1f} minutes"
        )


def _relative(path: Path, folder: Path) -> str:
    resolved, root = path.resolve(), folder.resolve()
    return str(resolved.relative_to(root) if resolved.is_relative_to(root) else resolved)
