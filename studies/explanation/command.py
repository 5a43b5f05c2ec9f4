"""`glassgait explain`: a page that tells why each joint does what it does, moment by moment."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from diagrams.locomotion import FixedCommand, LocomotionConfig
from diagrams.rollout import Rollout
from diagrams.visualization import open_meshcat
from models.a1.robot import joint_index
from models.errors import InputError
from models.files import write_atomically
from models.policies.library import load_expert
from models.task.gait import load_gait
from studies.console import console, say
from studies.distillation.library import find_student
from studies.evaluation.team import Team
from studies.explanation.page import explain_rollout, render_page
from studies.figures import save_figure
from studies.importance.additive_figures import contribution_figure
from studies.importance.study import draw_student
from studies.rollout.play import play


@dataclass(frozen=True)
class Explain:
    """Roll a student out alone and write a page that explains its every action.

    Attributes:
        gait: Name of a gait.
        policy: A kind of student whose actions are sums of terms, or the path of a policy file.
        joint: Joint that is shown first, and whose figures are drawn.
        step: Control step that is shown first, and whose contributions are drawn.
        command: Commanded speed, yaw rate and rhythm.
        seconds: Length of the rollout (s); a fall ends it before.
        seed: Seed of the sensors' noise.
        students: Folder of a distillation; by default runs/distillation/<gait>, and where that
            lacks the student, the shipped one.
        expert: Policy file of the expert; the shipped one by default.
        output: Folder of the page; runs/importance/<gait> by default.
    """

    gait: str = "trot"
    policy: str = "symbolic"
    joint: str = "FL_hip"
    step: int = 100
    command: FixedCommand = field(default_factory=lambda: FixedCommand(speed=0.5))
    seconds: float = 6.0
    seed: int = 0
    students: Path | None = None
    expert: Path | None = None
    output: Path | None = None

    def run(self) -> None:
        """Rolls out, explains, and writes the page."""
        gait, expert = load_gait(self.gait), load_expert(self.gait, self.expert)
        joint = joint_index(self.joint)
        student = find_student(self.policy, expert, self.students)
        # Refused before the rollout, where the student's actions are no sums of terms.
        student.explain(np.zeros(len(student.observation_names)), joint)
        folder = self.output or Path("runs/importance") / gait.name
        name = Path(self.policy).stem
        replay = folder / f"{name}_replay.html"
        say("rolling out")
        rollout = play(
            gait,
            Team(expert, student, period=0),
            LocomotionConfig(command=self.command, alternation_period=0, sensor_noise=1.0),
            open_meshcat(),
            replay,
            seconds=self.seconds,
            seed=self.seed,
        )
        self._check_step(rollout)
        say("splitting every action into its terms")
        explained = explain_rollout(student, rollout)
        observation = rollout["observations"][self.step]
        title = f"{gait.name.capitalize()}, {self.joint.replace('_', ' ')}, step {self.step}"
        local = folder / f"{name}_{self.joint}_step_{self.step}"
        save_figure(contribution_figure(student.explain(observation, joint), title), local)
        stems = draw_student(gait.name, name, student, joint, rollout["observations"], folder)
        page = render_page(
            gait=gait,
            policy_name=name,
            rollout=rollout,
            explained=explained,
            replay=replay.read_text(),
            joint=joint,
            step=self.step,
            figures=[stem.with_name(f"{stem.name}.png") for stem in (local, *stems)],
        )
        write_atomically(folder / "index.html", page)
        console.print(f"page written to {folder / 'index.html'}")

    def _check_step(self, rollout: Rollout) -> None:
        last = len(rollout.time) - 1
        if not 0 <= self.step <= last:
            end = "ended in a fall" if rollout.failed else "ends"
            raise InputError(
                f"--step {self.step}: the rollout {end} at step {last}; name one from 0 to {last}, "
                "or raise --seconds"
            )
