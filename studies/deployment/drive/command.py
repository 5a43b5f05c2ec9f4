"""`glassgait drive`: a robot and its controller in two processes, and what becomes of losses."""

import json
import time
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, ClassVar

import pandas as pd
import tyro
from annotated_types import Le

from glassgait.diagrams.commands import DrawnCommands, SliderCommand
from glassgait.diagrams.link import ControllerEnd, RobotEnd
from glassgait.diagrams.scenario import TRAINING, load_scenario
from glassgait.diagrams.visualization import open_meshcat
from glassgait.models.link.settings import LinkSettings
from glassgait.models.link.watchdog import Watchdog
from glassgait.models.settings import Count, NotNegative, Seed, Settings
from glassgait.models.task import CONTROL_PERIOD, EPISODE_STEPS
from glassgait.models.task.gait import load_gait
from glassgait.studies.common.console import console, progress_bar, say
from glassgait.studies.common.play import Seconds, pusher
from glassgait.studies.common.policies import find_policies
from glassgait.studies.common.rollouts import REPORTED_SEEDS, distilled_speeds
from glassgait.studies.common.run_folder import open_run
from glassgait.studies.common.tables import json_records, print_table, write_metrics, write_table
from glassgait.studies.deployment.drive.connection import open_lcm
from glassgait.studies.deployment.drive.controller import control
from glassgait.studies.deployment.drive.packet_loss import COLUMNS, TRIALS, LossyRobots
from glassgait.studies.deployment.drive.simulator import Record, RobotProcess
from glassgait.studies.view.command import OwnCommand
from glassgait.studies.view.live import first_interrupt

Link = Annotated[LinkSettings, tyro.conf.arg(name="")]


@dataclass(frozen=True)
class DriveController(Settings):
    """Answer what a robot in another process senses, until Ctrl-C.

    Attributes:
        gait: Name of a gait, or path of a gait file.
        policy: `expert`, a kind of student, or the path of a policy file.
        link: Where messages go.
        robot: Name of a robot, or path of its robot.yaml; by default that of the policies.
        source: Folder of a run of train, distill or refine to take policies from, in place of those
            that ship.
    """

    title: ClassVar[str] = "drive controller"

    gait: str = "trot"
    policy: str = "expert"
    link: Link = field(default_factory=LinkSettings)
    robot: str | None = None
    source: Path | None = None

    def run(self) -> None:
        """Answers, and reports what was counted."""
        gait = load_gait(self.gait)
        policy = find_policies(gait, self.source, self.robot).controller(self.policy)
        lcm = open_lcm(self.link)
        controller = ControllerEnd(policy.robot, gait, policy, lcm, self.link.names)
        say(f"listening on {self.link.names.sensors}; Ctrl-C ends")
        with first_interrupt() as interrupted:
            record = control(controller, lcm, interrupted)
        print_table(f"{gait.name}, {self.policy}: the controller", _table(record))


@dataclass(frozen=True)
class DriveSimulator(Settings):
    """Simulate a robot at real time that a controller in another process moves, until Ctrl-C.

    Attributes:
        gait: Name of a gait, or path of a gait file: commands are made for it.
        robot: Name of a robot, or path of its robot.yaml; by default the scenario's.
        scenario: Name of a scenario that ships, or path of a scenario file.
        command: The command, in place of the scenario's; what is left out is the scenario's. A
            scenario that names no command asks for 0.5 m/s.
        meshcat: Show the robot in Meshcat, and take commands from sliders there.
        seconds: Time to simulate (s), 3600 at most; without end by default.
        patience: Time to wait for the answer to each message of sensors (s): answers that come by
            then act at once. By default none is waited for, and answers act at the next step of
            the plant, as on a robot.
        watchdog: How long the robot waits for its controller.
        link: Where messages go.
        seed: Seed of the sensors' noise, of pushes and of drawn commands.
        output: New folder for what was counted; only printed by default.
    """

    title: ClassVar[str] = "drive simulator"

    gait: str = "trot"
    robot: str | None = None
    scenario: str = TRAINING
    command: OwnCommand = field(default_factory=OwnCommand)
    meshcat: bool = False
    seconds: Seconds | None = None
    patience: Annotated[NotNegative, Le(1.0)] = 0.0
    watchdog: Watchdog = field(default_factory=Watchdog)
    link: Link = field(default_factory=LinkSettings)
    seed: Seed = 0
    output: Path | None = None

    def run(self) -> None:
        """Simulates, and reports what was counted."""
        gait, scenario = load_gait(self.gait), load_scenario(self.scenario)
        if self.robot is not None:
            scenario = replace(scenario, robot=self.robot)
        if self.meshcat:
            scenario = replace(scenario, command=SliderCommand())
        else:
            scenario = self.command.over(scenario)
        lcm = open_lcm(self.link)
        inputs = {"gait": gait.digest(), "world": scenario.digest()}
        opened = (
            open_run(self.output, study="drive", settings=self, inputs=inputs, resume=False)
            if self.output
            else nullcontext()
        )
        with opened:
            meshcat = open_meshcat() if self.meshcat else None
            robot = RobotEnd(
                gait,
                scenario,
                lcm,
                self.link.names,
                watchdog=self.watchdog,
                session=time.time_ns(),
                seed=self.seed,
                meshcat=meshcat,
            )
            if meshcat is not None:
                say(f"open {meshcat.web_url()} and move the sliders under 'Open Controls'")
            say(f"sending on {self.link.names.sensors}, waiting for a controller; Ctrl-C ends")
            pushed = pusher(robot.simulator, scenario, self.seed)
            process = RobotProcess(robot, lcm, patience=self.patience, pushed=pushed)
            n_steps = None if self.seconds is None else round(self.seconds / CONTROL_PERIOD)
            with first_interrupt() as interrupted:
                record = process.run(n_steps, interrupted)
            if self.output:
                write_table(_table(record), self.output / "link")
                write_metrics(record, self.output / "metrics.json")
        print_table(f"{gait.name}: the robot", _table(record))
        if self.output:
            console.print(f"written to {self.output}")


@dataclass(frozen=True)
class DrivePacketLoss(Settings):
    """Lose messages on purpose, in one process and simulated time, and count what happens.

    Attributes:
        gait: Name of a gait, or path of a gait file.
        policy: `expert`, a kind of student, or the path of a policy file.
        scenario: Name of a scenario that ships, or path of a scenario file. One that names no
            command lets robots go at the speeds of distillation.
        n_robots: Robots of each trial.
        n_steps: Control steps of each robot.
        watchdog: How long robots wait for their controller.
        seed: Seed of commands, noise and losses.
        robot: Name of a robot, or path of its robot.yaml; by default that of the policies.
        source: Folder of a run of train, distill or refine to take policies from, in place of those
            that ship.
        resume: Continue the run that the folder holds.
        output: Folder of the results; runs/drive/<gait>/<policy> by default.
    """

    title: ClassVar[str] = "drive packet-loss"

    gait: str = "trot"
    policy: str = "expert"
    scenario: str = TRAINING
    n_robots: Count = 26
    n_steps: Count = EPISODE_STEPS
    watchdog: Watchdog = field(default_factory=Watchdog)
    seed: Seed = REPORTED_SEEDS[0]
    robot: str | None = None
    source: Path | None = None
    resume: bool = False
    output: Path | None = None

    def run(self) -> None:
        """Walks through every trial, and writes the table."""
        gait, scenario = load_gait(self.gait), load_scenario(self.scenario)
        found = find_policies(gait, self.source, self.robot)
        policy = found.controller(self.policy)
        if not scenario.names_a_command:
            scenario = replace(scenario, command=DrawnCommands(distilled_speeds(gait)))
        folder = self.output or found.output("drive") / Path(self.policy).stem
        inputs = {
            "gait": gait.digest(),
            "world": scenario.digest(),
            "expert": policy.expert.digest(),
            "policy": policy.policy.digest(),
        }
        run = {"study": "drive", "settings": self, "resume": self.resume}
        with open_run(folder, **run, inputs=inputs):
            rows = []
            with progress_bar(len(TRIALS)) as (progress, task):
                for number, trial in enumerate(TRIALS):
                    progress.update(task, text=trial.title)
                    done = folder / "trials" / f"{number}.json"
                    if not done.exists():
                        robots = LossyRobots(
                            gait, policy, scenario, trial, watchdog=self.watchdog, seed=self.seed
                        )
                        write_metrics(robots.walk(self.n_robots, self.n_steps), done)
                    rows.append(json.loads(done.read_text()))
                    progress.advance(task)
            table = pd.DataFrame(rows, columns=list(COLUMNS))
            write_table(table, folder / "losses")
            write_metrics(json_records(table), folder / "metrics.json")
        print_table(f"{gait.name}, {self.policy}: lost and late messages", table)
        console.print(f"written to {folder}")


def _table(record: Record) -> pd.DataFrame:
    return pd.DataFrame({"what": record.keys(), "value": record.values()})
