"""`glassgait drive dropout`: what a robot does whose controller vanishes."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar

from annotated_types import Ge, Le

from glassgait.diagrams.scenario import TRAINING, load_scenario
from glassgait.models.link.watchdog import Watchdog
from glassgait.models.settings import Count, NotNegative, Seed, Settings
from glassgait.models.task.gait import load_gait
from glassgait.studies.common.console import console
from glassgait.studies.common.policies import find_policies
from glassgait.studies.common.run_folder import open_run
from glassgait.studies.common.tables import json_records, print_table, write_metrics, write_table
from glassgait.studies.deployment.drive.dropout import (
    lower,
    pushed,
    silence_table,
    walk_until_silent,
)


@dataclass(frozen=True)
class DriveDropout(Settings):
    """Silence controllers for good at many moments of the stride, and count the falls.

    Attributes:
        gait: Name of a gait, or path of a gait file.
        policy: `expert`, a kind of student, or the path of a policy file.
        scenario: Name of a scenario that ships, or path of a scenario file; its commands are left
            out: robots go at thirds of the fastest speed of distillation.
        n_moments: Robots of each speed; each loses its controller at another moment.
        push: What is added to the trunk's velocity at that moment, in a drawn direction (m/s).
        seconds: Time from then to the end (s).
        watchdog: How long robots wait for their controller.
        seed: Seed of dwell, turning, noise, initial states and pushes.
        robot: Name of a robot, or path of its robot.yaml; by default that of the policies.
        source: Folder of a run of train, distill or refine to take policies from, in place of those
            that ship.
        output: New folder of the results; runs/drive/<gait>/silence by default.
    """

    title: ClassVar[str] = "drive dropout"

    gait: str = "trot"
    policy: str = "expert"
    scenario: str = TRAINING
    n_moments: Count = 32
    push: Annotated[NotNegative, Le(20.0)] = 0.0
    seconds: Annotated[float, Ge(0.1), Le(60.0)] = 2.0
    watchdog: Watchdog = field(default_factory=Watchdog)
    seed: Seed = 2000
    robot: str | None = None
    source: Path | None = None
    output: Path | None = None

    def run(self) -> None:
        """Lets robots walk, silences their controllers, and writes the table."""
        gait, scenario = load_gait(self.gait), load_scenario(self.scenario)
        found = find_policies(gait, self.source, self.robot)
        policy = found.controller(self.policy)
        folder = self.output or found.output("drive") / "silence"
        inputs = {
            "gait": gait.digest(),
            "world": scenario.digest(),
            "expert": policy.expert.digest(),
            "policy": policy.policy.digest(),
        }
        run = {"study": "drive", "settings": self, "resume": False}
        with open_run(folder, **run, inputs=inputs):
            left = walk_until_silent(
                gait, policy, scenario, n_moments=self.n_moments, seed=self.seed
            )
            left = pushed(left, self.push, self.seed)
            lowered = lower(
                policy.robot, left, scenario.station, self.watchdog, seconds=self.seconds
            )
            table = silence_table(left, lowered)
            write_table(table, folder / "silence")
            write_metrics(json_records(table), folder / "metrics.json")
        print_table(f"{gait.name}, {self.policy}: silent for good", table)
        console.print(f"written to {folder}")
