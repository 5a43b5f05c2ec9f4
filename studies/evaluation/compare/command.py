"""`glassgait evaluate compare`: two policies side by side."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar

import pandas as pd
import tyro
from annotated_types import MinLen

from glassgait.diagrams.commands import SliderCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.pair_replay import ReplayedRobot, save_pair_replay
from glassgait.diagrams.rollout import Rollout
from glassgait.diagrams.scenario import TRAINING, Scenario, load_scenarios
from glassgait.diagrams.task_config import NO_SLIDERS
from glassgait.models.errors import InputError
from glassgait.models.files import write_atomically
from glassgait.models.settings import DISTINCT, FEW, Settings
from glassgait.models.task.gait import Gait, load_gait
from glassgait.studies.common.console import console, say
from glassgait.studies.common.experts import find_expert
from glassgait.studies.common.figures import save_figure
from glassgait.studies.common.parallel.loop import parallel_backend
from glassgait.studies.common.rollouts.config import RolloutConfig
from glassgait.studies.common.rollouts.jobs import inputs_of, run_jobs
from glassgait.studies.common.rollouts.play import Seconds, roll_one_out
from glassgait.studies.common.rollouts.worlds import jobs_in_worlds
from glassgait.studies.common.run_folder import open_run
from glassgait.studies.common.sweep import WorkersConfig
from glassgait.studies.common.tables import json_records, print_table, write_metrics, write_table
from glassgait.studies.evaluation.compare.figures import difference_figure
from glassgait.studies.evaluation.compare.lines import LineChanges, changed_lines, told_changes
from glassgait.studies.evaluation.compare.scores import readable_scores, score_table
from glassgait.studies.evaluation.compare.sides import Side, find_side
from glassgait.studies.evaluation.compare.targets import (
    TITLES,
    TargetDifference,
    joint_table,
    target_difference,
    told_differences,
)
from glassgait.studies.view.command import OwnCommand


@dataclass(frozen=True)
class Compare(Settings):
    """Set two policies side by side: their lines, targets, scores, and one replay of both.

    Attributes:
        a: The policy A, which acts where targets are compared: `expert`, a kind of student, or the
            path of a policy file.
        b: The policy B, named likewise.
        gait: Name of a gait, or path of a gait file.
        scenario: The scenarios of the scores: names of those that ship, or `all` of them, and
            paths of scenario files. Targets and replay are of the first one. `--worlds` is another
            name for it.
        command: The command of targets and replay, in place of the scenario's; what is left out is
            the scenario's. A scenario that names no command asks for 0.5 m/s.
        seconds: Length of the rollout of targets and replay (s), 3600 at most; a fall ends it
            before.
        rollouts: How robots are rolled out for the scores, at the speeds of distillation unless
            others are named; its first seed is that of targets and replay too.
        workers: Where the rollouts of the scores run.
        distillation: Folder of a distillation; by default runs/distillation/<gait>, and where that
            lacks the student, the shipped one.
        expert: Policy file of the expert; by default the shipped one, or what was trained here.
        resume: Continue the run that the folder holds.
        output: Folder of the results; runs/compare/<gait>/<A>_<B> by default.
    """

    title: ClassVar[str] = "compare"

    a: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="A")] = "statewise_symbolic"
    b: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="B")] = "sparse_formula"
    gait: str = "trot"
    scenario: Annotated[
        tuple[str, ...], MinLen(1), FEW, DISTINCT, tyro.conf.arg(aliases=("--worlds",))
    ] = (TRAINING,)
    command: OwnCommand = field(default_factory=OwnCommand)
    seconds: Seconds = 10.0
    rollouts: Annotated[RolloutConfig, tyro.conf.arg(name="")] = field(
        default_factory=lambda: RolloutConfig(n_seeds=1)
    )
    workers: Annotated[WorkersConfig, tyro.conf.arg(name="")] = field(default_factory=WorkersConfig)
    distillation: Path | None = None
    expert: Path | None = None
    resume: bool = False
    output: Path | None = None

    def run(self) -> None:
        """Runs the study."""
        gait = load_gait(self.gait)
        expert = find_expert(gait, self.expert)
        a = find_side("A", self.a, expert, self.distillation)
        b = find_side("B", self.b, expert, self.distillation)
        scenarios = load_scenarios(self.scenario)
        walkers = {side.letter: side.walker for side in (a, b)}
        jobs = jobs_in_worlds(gait, walkers, scenarios, self.rollouts)
        world = self._world_of_replay(gait, next(iter(scenarios.values())))
        changes = changed_lines(a, b)
        folder = self.output or Path("runs/compare") / gait.name / f"{a.stem}_{b.stem}"
        # By its side, for files that change places are other files.
        inputs = inputs_of(jobs) | {side.letter: side.policy.digest() for side in (a, b)}
        with (
            open_run(
                folder, study="evaluate compare", settings=self, inputs=inputs, resume=self.resume
            ),
            parallel_backend(self.workers.backend),
        ):
            for line in changes.colored() if changes else ():
                console.print(line, soft_wrap=True)
            say(told_changes(a, b, changes))
            scores = run_jobs(jobs, folder / "rollouts", processes=self.workers.processes)
            say("letting each walk for the replay")
            walks = {side.letter: self._walk(gait, side, world) for side in (a, b)}
            difference = target_difference(walks["A"], a.policy, b.policy)
            joints = joint_table(difference)
            titles = {name: scenario.title for name, scenario in scenarios.items()}
            table = score_table(scores, titles)
            _write_lines(changes, folder)
            _write_targets(difference, joints, f"{gait.name}: {a.title} acts; {b.title}", folder)
            write_table(readable_scores(table, (a, b)), folder / "scores")
            left, right = (_replayed(side, walks[side.letter]) for side in (a, b))
            save_pair_replay(left, right, folder / "replay.html")
            metrics = {
                "policies": {side.letter: side.name for side in (a, b)},
                "lines": {"only_a": changes.only_a, "only_b": changes.only_b} if changes else None,
                "targets": json_records(joints),
                "scores": json_records(table),
                "walks": {letter: _end(walk) for letter, walk in walks.items()},
            }
            write_metrics(metrics, folder / "metrics.json")
        print_table(f"{gait.name}: both in each scenario", readable_scores(table, (a, b)))
        say(told_differences(joints))
        console.print(f"written to {folder}; open {folder / 'replay.html'}")

    def _world_of_replay(self, gait: Gait, first: Scenario) -> Scenario:
        """Returns the world of targets and replay.

        Raises:
            InputError: if no single robot can be rolled out there.
        """
        world = self.command.over(first)
        if isinstance(world.command, SliderCommand):
            raise InputError(f"{world.refused_as()}: {NO_SLIDERS}")
        if world.station.engine != "drake":
            raise InputError(
                f"{world.refused_as()}: targets and replay are of the first scenario, and one "
                "robot needs Drake; name another first with --worlds, such as training"
            )
        world.command.check(gait)
        return world

    def _walk(self, gait: Gait, side: Side, world: Scenario) -> Rollout:
        diagram = MakeLocomotion(gait, world, policy=side.walker)
        return roll_one_out(diagram, world, seconds=self.seconds, seed=self.rollouts.seed)


def _write_lines(changes: LineChanges | None, folder: Path) -> None:
    if changes and changes.lines:
        write_atomically(folder / "lines.diff", "\n".join(changes.lines) + "\n")


def _write_targets(
    difference: TargetDifference, joints: pd.DataFrame, title: str, folder: Path
) -> None:
    write_table(joints.rename(columns=TITLES), folder / "targets")
    save_figure(difference_figure(difference, title), folder / "targets")


def _replayed(side: Side, walk: Rollout) -> ReplayedRobot:
    end = _end(walk)
    told = f", fell after {end['seconds']:.2f} s" if end["fell"] else ""
    return ReplayedRobot(side.letter, f"{side.title}{told}", side.color, walk, side.policy.robot)


def _end(walk: Rollout) -> dict[str, Any]:
    """Tells how a rollout ended."""
    return {"fell": walk.failed, "seconds": round(float(walk.time[-1] - walk.time[0]), 6)}
