"""`glassgait refine`: lets a policy of formulas learn on, in closed loop."""

from dataclasses import field
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from glassgait.models.errors import InputError
from glassgait.models.formulas.expression import ZERO
from glassgait.models.formulas.numbers import WeightedSum
from glassgait.models.policies.library import policy_path
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.settings import checked
from glassgait.studies.common.console import console
from glassgait.studies.common.policies import EXPERT
from glassgait.studies.common.run_folder import CHECKPOINT_NAME, open_run
from glassgait.studies.distillation.refinement.config import RefinementConfig
from glassgait.studies.distillation.refinement.study import RefinementRun
from glassgait.studies.distillation.students.library import OnePolicy


@checked
class Refine(OnePolicy):
    """Let a policy of formulas learn on in closed loop, by PPO: its numbers change alone.

    Attributes:
        config: Settings of the run.
        output: Folder of the run; runs/refine/<gait>/<policy> by default.
        resume: Continue the run that the folder holds.
    """

    title: ClassVar[str] = "refine"

    config: Annotated[RefinementConfig, tyro.conf.arg(name="")] = field(
        default_factory=RefinementConfig
    )
    output: Path | None = None
    resume: bool = False

    def run(self) -> None:
        """Runs the study."""
        found, named = self.find()
        gait = found.gait
        # Where there is no expert, the second says so.
        policy, expert = found.formulas(named), found.expert_of(named) or found.expert
        terms = self.config.terms
        if terms is not None and not _is_weighted_sum(policy):
            raise InputError(
                f"--policy {named}: has numbers that are not weights of terms, so that none can be "
                "dropped; name a page, or leave --terms out"
            )
        name = Path(named).stem
        folder = self.output or found.output(self.title) / name
        with open_run(
            folder,
            study=self.title,
            settings=self.config,
            inputs={"gait": gait.digest(), "policy": policy.digest(), "expert": expert.digest()},
            resume=self.resume,
            free=("updates",),
        ):
            begun = (folder / CHECKPOINT_NAME).exists()
            run = RefinementRun(self.config, gait, expert, policy, folder, name=name, resume=begun)
            # The formulas observe by its estimator, wherever the folder is moved.
            expert.save(policy_path(folder, EXPERT))
            run.run()
        console.print(f"formulas written to {folder / name}{policy.suffix}")


def _is_weighted_sum(policy: FormulaPolicy) -> bool:
    """Returns whether each number of a policy's formulas is the weight of one of its terms."""
    sums = map(WeightedSum.of, policy.to_file().written().values())
    return all(own is not None and own.rest == ZERO for own in sums)
