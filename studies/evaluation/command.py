"""`glassgait evaluate`: rolls policies out and scores them."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro
import yaml

from models.errors import InputError
from models.files import write_atomically
from models.policies.library import load_expert, load_policy
from models.task.gait import load_gait
from studies.console import console, say
from studies.distillation.study import load_students
from studies.evaluation.alternation import evaluate_alternation
from studies.evaluation.config import WORLDS, RolloutConfig, WorldName
from studies.evaluation.figures import reward_figure
from studies.evaluation.rollouts import Team
from studies.evaluation.tables import alternation_table, standalone_table, world_table
from studies.evaluation.worlds import evaluate_worlds
from studies.figures import save_figure
from studies.records import to_plain
from studies.tables import print_table, write_metrics, write_table


@dataclass(frozen=True)
class Evaluate:
    """Roll policies out in closed loop and score them.

    Attributes:
        gait: Name of a gait.
        policy: `expert`; `students`, for those of a distillation at every alternation ratio; or the
            path of a student's policy file, to be rolled out alone.
        worlds: Physics to roll out in, or `all`; students are rolled out in the training physics.
        rollouts: How robots are rolled out.
        students: Folder of the distillation; runs/distillation/<gait> by default.
        expert: Policy file of the expert; the shipped one by default.
        output: Folder of the results; runs/evaluation/<gait> by default.
    """

    gait: str = "trot"
    policy: str = "expert"
    worlds: tuple[WorldName | Literal["all"], ...] = ("training",)
    rollouts: Annotated[RolloutConfig, tyro.conf.arg(name="")] = field(
        default_factory=RolloutConfig
    )
    students: Path | None = None
    expert: Path | None = None
    output: Path | None = None

    def run(self) -> None:
        """Runs the study."""
        folder = self.output or Path("runs/evaluation") / self.gait
        record = yaml.safe_dump(to_plain(self), sort_keys=False)
        if self.policy == "students":
            self._evaluate_students(folder, record)
        else:
            self._evaluate_worlds(folder, record)

    def _evaluate_students(self, folder: Path, record: str) -> None:
        gait, expert = load_gait(self.gait), load_expert(self.gait, self.expert)
        students = load_students(self.students or Path("runs/distillation") / self.gait, expert)
        scores = evaluate_alternation(gait, expert, students, self.rollouts, say)
        folder = folder / "students"
        write_table(scores, folder / "robots")
        write_table(alternation_table(scores), folder / "ratios")
        write_metrics(alternation_table(scores).to_dict(orient="records"), folder / "metrics.json")
        table = standalone_table(scores)
        write_table(table, folder / "standalone")
        save_figure(reward_figure(scores, gait.name), folder / "reward")
        write_atomically(folder / "config.yaml", record)
        print_table(f"{gait.name}: students alone", table)
        console.print(f"written to {folder}")

    def _evaluate_worlds(self, folder: Path, record: str) -> None:
        gait, expert = load_gait(self.gait), load_expert(self.gait, self.expert)
        team, name = Team(expert), "expert"
        if self.policy != "expert":
            path = Path(self.policy)
            if path.suffix != ".safetensors":
                raise InputError(
                    f"unknown policy {self.policy!r}; say 'expert', 'students', or give the path "
                    "of a policy file ending in .safetensors"
                )
            student = load_policy(path)
            student.check(gait=gait.name, observation_names=expert.observation_names)
            team, name = Team(expert, student, period=0), path.stem
        worlds = tuple(WORLDS) if "all" in self.worlds else self.worlds
        scores = evaluate_worlds(gait, team, worlds, self.rollouts, say)
        folder = folder / name
        write_table(scores, folder / "robots")
        table = world_table(scores)
        write_table(table, folder / "worlds")
        write_metrics(scores.to_dict(orient="records"), folder / "metrics.json")
        write_atomically(folder / "config.yaml", record)
        print_table(f"{gait.name}: {name}", table)
        console.print(f"written to {folder}")
