"""`glassgait reproduce convergence`: which contact solvers and time steps agree."""

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar

import pandas as pd
import tyro

from glassgait.models.policies.controller import alone
from glassgait.models.settings import Settings
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import load_gait
from glassgait.studies.common.cases import Case, digests_of
from glassgait.studies.common.console import console, say
from glassgait.studies.common.experts import find_expert
from glassgait.studies.common.figures import save_figure
from glassgait.studies.common.rollouts.config import RolloutConfig
from glassgait.studies.common.rollouts.scoring import rollout_cases, run_rollouts
from glassgait.studies.common.run_folder import open_run
from glassgait.studies.common.tables import print_table, write_metrics, write_table
from glassgait.studies.reproduction.convergence.drop import drop_robot
from glassgait.studies.reproduction.convergence.figures import convergence_figure
from glassgait.studies.reproduction.convergence.variants import VARIANTS


@dataclass(frozen=True)
class Convergence(Settings):
    """Drop the robot and roll an expert out with every contact solver and time step.

    Attributes:
        gait: Name of the expert's gait, or path of a gait file.
        rollouts: How robots are rolled out.
        expert: Policy file of the expert; by default the shipped one, or what was trained here.
        resume: Continue the run that the folder holds.
        output: Folder of the results; runs/convergence/<gait> by default.
    """

    title: ClassVar[str] = "convergence"

    gait: str = "trot"
    rollouts: Annotated[RolloutConfig, tyro.conf.arg(name="")] = field(
        default_factory=lambda: RolloutConfig(n_robots=2, n_steps=500)
    )
    expert: Path | None = None
    resume: bool = False
    output: Path | None = None

    def run(self) -> None:
        """Runs the study."""
        gait = load_gait(self.gait)
        folder = self.output or Path("runs/convergence") / gait.name
        policy = alone(find_expert(gait, self.expert))
        jobs = [
            job
            for variant in reversed(VARIANTS)
            for job in rollout_cases(
                {"variant": variant.scenario.title},
                gait,
                policy,
                variant.scenario,
                self.rollouts,
            )
        ]
        with open_run(
            folder,
            study="reproduce convergence",
            settings=self,
            inputs=digests_of(jobs),
            resume=self.resume,
        ):
            results = _measure(jobs, folder)
            write_table(results, folder / "convergence")
            write_metrics(results.to_dict(orient="records"), folder / "metrics.json")
            save_figure(convergence_figure(results), folder / "convergence")
        print_table(f"{gait.name}: contact solvers and time steps", results)
        console.print(f"written to {folder}")


def _measure(jobs: list[Case], folder: Path) -> pd.DataFrame:
    say("dropping the robot")
    drops = pd.DataFrame(
        [
            {
                "variant": variant.scenario.title,
                "family": variant.family,
                "resolution": variant.resolution,
                **asdict(drop_robot(variant.scenario)),
            }
            for variant in VARIANTS
        ]
    )
    say("rolling out")
    return drops.merge(_means(run_rollouts(jobs, folder / "rollouts")), on="variant")


def _means(scores: pd.DataFrame) -> pd.DataFrame:
    scores = scores.assign(survived=scores["steps"] * CONTROL_PERIOD)
    means = scores.groupby("variant", sort=False).agg(
        robots=("fell", "size"),
        falls=("fell", "sum"),
        survived=("survived", "mean"),
        going_speed_error=("going_speed_error", "mean"),
        yaw_rate_error=("yaw_rate_error", "mean"),
        rhythm=("rhythm", "mean"),
    )
    return means.reset_index()
