"""`glassgait explain page`: a page that explains every action of a rollout."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
import yaml
from annotated_types import Ge

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.visualization import open_meshcat
from glassgait.models.errors import InputError
from glassgait.models.files import digest, read_yaml, write_atomically
from glassgait.models.robots.quadruped import joint_index
from glassgait.models.settings import Seed, Settings
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import load_gait
from glassgait.studies.common.console import console, say
from glassgait.studies.common.figures import save_figure
from glassgait.studies.common.play import Seconds, play
from glassgait.studies.common.policies import find_policies
from glassgait.studies.common.run_folder import refuse_run, to_plain
from glassgait.studies.distillation.students.certificates import find_certificate
from glassgait.studies.distillation.students.library import default_student
from glassgait.studies.distillation.students.registry import sums_of_terms
from glassgait.studies.explanation.certificate import certificate_panel
from glassgait.studies.explanation.page import explain_rollout, render_page
from glassgait.studies.importance.figures import contribution_figure, draw_student

CONFIG = "config.yaml"
"""File beside the page that records its run."""

DIGEST = "policy_sha256"
"""Key of that file: the digest of the policy's file."""

STEP = 100
"""Step that is shown first, where the rollout lasts so long and a person names none."""


@dataclass(frozen=True)
class ExplainPage(Settings):
    """Roll a student out alone and write a page that explains its every action.

    Attributes:
        gait: Name of a gait, or path of a gait file.
        policy: A kind of student whose actions are sums of terms, or the path of a policy file; by
            default one that ships with the gait.
        joint: Joint that is shown first, and whose figures are drawn.
        step: Control step that is shown first, and whose contributions are drawn; by default 100,
            or the last one of a shorter rollout.
        command: Commanded speed, yaw rate and rhythm.
        seconds: Length of the rollout (s), 3600 at most; a fall ends it before.
        seed: Seed of the sensors' noise.
        robot: Name of a robot, or path of its robot.yaml; by default that of the policies.
        source: Folder of a run of train, distill or refine to take policies from, in place of those
            that ship.
        certificate: Certificate of the policy, whose claims the page shows; by default the one in
            runs/certification/<gait> that is of this very policy, or a shipped one.
        output: Folder of the page; runs/explanation/<gait>/<policy> by default.
    """

    title: ClassVar[str] = "explain"

    gait: str = "trot"
    policy: str | None = None
    joint: str = "FL_hip"
    step: Annotated[int, Ge(0)] | None = None
    command: FixedCommand = field(default_factory=lambda: FixedCommand(speed=0.5))
    seconds: Seconds = 6.0
    seed: Seed = 0
    robot: str | None = None
    source: Path | None = None
    certificate: Path | None = None
    output: Path | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_step(round(self.seconds / CONTROL_PERIOD), "ends")

    def run(self) -> None:
        """Rolls out, explains, and writes the page."""
        found = find_policies(load_gait(self.gait), self.source, self.robot)
        gait = found.gait
        policy = self.policy or default_student(found)
        if policy == "expert":
            raise InputError(
                "--policy expert: the expert's actions are no sums of terms; name a student, of "
                f"the kinds {', '.join(sums_of_terms())}"
            )
        joint = joint_index(self.joint)
        path, controller = found.file(policy), found.controller(policy)
        student = controller.policy
        # Refused before the rollout, where the student's actions are no sums of terms.
        student.explain(np.zeros(len(student.observation_names)), joint)
        certificate = find_certificate(path, gait, self.certificate, student.robot)
        name = Path(policy).stem
        folder = self.output or found.output("explanation") / name
        whose = {**to_plain(self), "policy": policy}
        _refuse_another(folder, whose)
        replay = folder / f"{name}_replay.html"
        say("rolling out")
        rollout = play(
            gait,
            controller,
            Scenario(command=self.command),
            open_meshcat(),
            replay,
            seconds=self.seconds,
            seed=self.seed,
        )
        last = len(rollout.time) - 1
        self._check_step(last, "ended in a fall" if rollout.failed else "ends")
        step = min(STEP, last) if self.step is None else self.step
        say("splitting every target into its terms")
        explained = explain_rollout(student, rollout)
        title = f"{gait.name.capitalize()}, {self.joint.replace('_', ' ')}, step {step}"
        local = folder / f"{name}_{self.joint}_step_{step}"
        terms = student.explain(rollout["observations"][step], joint)
        save_figure(contribution_figure(explained[joint].active_of(terms, step), title), local)
        stems = draw_student(gait.name, name, student, joint, rollout["observations"], folder)
        page = render_page(
            gait=gait,
            policy_name=name,
            policy=student,
            rollout=rollout,
            explained=explained,
            replay=replay.read_text(),
            joint=joint,
            step=step,
            figures=[stem.with_name(f"{stem.name}.png") for stem in (local, *stems)],
            certificate=certificate
            and certificate_panel(certificate, student, path, rollout["observations"]),
        )
        record = yaml.safe_dump({**whose, "step": step, DIGEST: digest(path)}, sort_keys=False)
        write_atomically(folder / CONFIG, record)
        write_atomically(folder / "index.html", page)
        console.print(f"page written to {folder / 'index.html'}")

    def _check_step(self, last: int, end: str) -> None:
        if self.step is not None and self.step > last:
            raise InputError(
                f"--step {self.step}: the rollout {end} at step {last}; name one from 0 to {last}, "
                "or raise --seconds"
            )


def _refuse_another(folder: Path, whose: dict[str, Any]) -> None:
    """Refuses a folder that holds another student's page, or a page of something else."""
    refuse_run(folder)
    path = folder / CONFIG
    if (folder / "index.html").exists() and not path.exists():
        raise InputError(
            f"{folder}: holds a page that 'glassgait explain page' did not write; name a new "
            "folder with --output"
        )
    theirs = read_yaml(path) if path.exists() else whose
    for key in ("gait", "policy", "source"):
        if not isinstance(theirs, dict) or theirs.get(key) != whose[key]:
            raise InputError(
                f"{folder}: holds the page of another student; name a new folder with --output"
            )
