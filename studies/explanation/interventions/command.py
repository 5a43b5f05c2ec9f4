"""`glassgait explain interventions`: whether what a page of formulas says is true of the robot."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import pandas as pd
from annotated_types import Ge

from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.settings import Count, Seed, Settings
from glassgait.models.task.gait import Gait, load_gait
from glassgait.studies.common.console import console, say
from glassgait.studies.common.figures import save_figure
from glassgait.studies.common.policies import find_policies
from glassgait.studies.common.rollouts import REPORTED_SEEDS
from glassgait.studies.common.run_folder import open_run
from glassgait.studies.common.tables import json_records, print_table, write_metrics, write_table
from glassgait.studies.distillation.students.library import default_student
from glassgait.studies.distillation.students.registry import student_title
from glassgait.studies.explanation.interventions.derivation import derive_claims, refuse_too_few
from glassgait.studies.explanation.interventions.figures import claims_figure
from glassgait.studies.explanation.interventions.study import Examiner, readable_table
from glassgait.studies.explanation.interventions.terms import readable_terms
from glassgait.studies.explanation.interventions.walks import Walk, walk


@dataclass(frozen=True)
class ExplainInterventions(Settings):
    """Test what a policy of formulas says: change a term, and see whether the robot moves so.

    Attributes:
        gait: Name of a gait, or path of a gait file.
        policy: Kind of student, or path of a formula file; of the shipped formulas the shortest by
            default.
        n_claims: Claims of joints, one a term, the terms that move a target most.
        n_robots: Robots of each walk.
        n_steps: Control steps of each.
        seed: Seed of starts, commands and noise, the same for every walk.
        robot: Name of a robot, or path of its robot.yaml; by default that of the policies.
        source: Folder of a run of train, distill or refine to take policies from, in place of those
            that ship.
        resume: Continue the run that the folder holds.
        output: Folder of the results; runs/claims/<gait>/<policy> by default.
    """

    title: ClassVar[str] = "claims"

    gait: str = "trot"
    policy: str | None = None
    n_claims: Count = 8
    n_robots: Annotated[Count, Ge(2)] = 26
    n_steps: Annotated[Count, Ge(2)] = 500
    seed: Seed = REPORTED_SEEDS[0]
    robot: str | None = None
    source: Path | None = None
    resume: bool = False
    output: Path | None = None

    def run(self) -> None:
        """Derives claims, tests them, and writes how they did."""
        found = find_policies(load_gait(self.gait), self.source, self.robot)
        gait = found.gait
        name = self.policy or default_student(found)
        policy, expert = found.formulas(name), found.expert_of(name)
        stem = Path(name).stem
        folder = self.output or found.output("claims") / stem
        # Before a folder is claimed: a refusal leaves nothing behind.
        refuse_too_few(len(readable_terms(policy.to_file())), self.n_claims)
        inputs = {"gait": gait.digest(), "expert": expert.digest(), "policy": policy.digest()}
        with open_run(
            folder, study="explain interventions", settings=self, inputs=inputs, resume=self.resume
        ):
            table, plain = self._test(gait, expert, policy, folder)
            write_table(readable_table(table), folder / "claims")
            metrics = {
                "claims": json_records(table),
                "held": int(table["holds"].sum()),
                "tested": len(table),
                "falls": plain.falls,
            }
            write_metrics(metrics, folder / "metrics.json")
            title = f"{gait.name.capitalize()}, {student_title(stem)}"
            save_figure(claims_figure(table, title), folder / "claims")
        print_table(f"{gait.name}: what {student_title(stem)} says", readable_table(table))
        console.print(f"{metrics['held']} of {metrics['tested']} claims hold; written to {folder}")

    def _test(
        self, gait: Gait, expert: NeuralPolicy, policy: FormulaPolicy, folder: Path
    ) -> tuple[pd.DataFrame, Walk]:
        def walk_with(edited: FormulaPolicy) -> Walk:
            robots = {"n_robots": self.n_robots, "n_steps": self.n_steps, "seed": self.seed}
            return walk(gait, expert, edited, **robots)

        file = policy.to_file()
        say(f"{gait.name}: walking with the formulas as they are")
        plain = walk_with(policy)
        claims = derive_claims(file, plain, self.n_claims)
        return Examiner(file, plain, walk_with, folder).examine(claims), plain
