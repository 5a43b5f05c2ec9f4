"""`glassgait refine`: lets a policy of formulas learn on, in closed loop."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from glassgait.models.errors import InputError
from glassgait.models.policies.library import policy_path
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.settings import Settings
from glassgait.models.task.gait import load_gait
from glassgait.studies.common.console import console
from glassgait.studies.common.policies import EXPERT, find_policies
from glassgait.studies.common.run_folder import open_run
from glassgait.studies.distillation.refinement.formula_network import FormulaNetwork
from glassgait.studies.distillation.refinement.study import RefinementConfig, RefinementRun
from glassgait.studies.distillation.students.library import default_student
from glassgait.studies.training.checkpoint import CHECKPOINT_NAME
from glassgait.studies.training.command import show_learning


@dataclass(frozen=True)
class Refine(Settings):
    """Let a policy of formulas learn on in closed loop, by PPO: its numbers change alone.

    Attributes:
        gait: Name of a gait, or path of a gait file.
        policy: Kind of student, or path of a formula file; of the shipped formulas the shortest by
            default.
        config: Settings of the run.
        robot: Name of a robot, or path of its robot.yaml; by default that of the policies.
        source: Folder of a run of train, distill or refine to take policies from, in place of those
            that ship.
        output: Folder of the run; runs/refinement/<gait>/<policy> by default.
        resume: Continue from the folder's checkpoint.
    """

    title: ClassVar[str] = "refine"

    gait: str = "trot"
    policy: str | None = None
    config: Annotated[RefinementConfig, tyro.conf.arg(name="")] = field(
        default_factory=RefinementConfig
    )
    robot: str | None = None
    source: Path | None = None
    output: Path | None = None
    resume: bool = False

    def run(self) -> None:
        """Runs the study."""
        gait = load_gait(self.gait)
        found = find_policies(gait, self.source, self.robot)
        named = self.policy or default_student(found)
        policy, expert = found.formulas(named), found.expert_of(named)
        terms = self.config.terms
        if terms is not None and not _is_weighted_sum(policy):
            raise InputError(
                f"--policy {named}: has numbers that are not weights of terms, so that none can be "
                "dropped; name a page, or leave --terms out"
            )
        name = Path(named).stem
        folder = self.output or found.output("refinement") / name
        with open_run(
            folder,
            study="refine",
            settings=self.config,
            inputs={
                "gait": gait.digest(),
                "policy": policy.digest(),
                "expert": expert.digest(),
            },
            resume=self.resume,
            free=("updates",),
        ):
            begun = (folder / CHECKPOINT_NAME).exists()
            run = RefinementRun(self.config, gait, expert, policy, folder, name=name, resume=begun)
            # The formulas observe by its estimator, wherever the folder is moved.
            expert.save(policy_path(folder, EXPERT))
            show_learning(run)
        console.print(f"formulas written to {folder / name}{policy.suffix}")


def _is_weighted_sum(policy: FormulaPolicy) -> bool:
    """Returns whether each number of a policy's formulas is the weight of one of its terms."""
    return FormulaNetwork(policy).n_numbers == policy.n_terms()
