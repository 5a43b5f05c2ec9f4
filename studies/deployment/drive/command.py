"""`glassgait drive`: a robot and its controller in two processes, and what becomes of losses."""

import time
from abc import abstractmethod
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, ClassVar

import pandas as pd
import tyro
from annotated_types import Ge, Le
from pydrake.lcm import DrakeLcm

from glassgait.diagrams.commands import SliderCommand
from glassgait.diagrams.link import ControllerEnd, RobotEnd
from glassgait.diagrams.scenario import TRAINING, Scenario, load_scenario
from glassgait.diagrams.visualization import open_meshcat
from glassgait.models.errors import InputError, shown
from glassgait.models.link.channels import LinkSettings
from glassgait.models.link.watchdog import Watchdog
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.policies.library import find_gait
from glassgait.models.settings import Count, NotNegative, Seed, Settings
from glassgait.models.task import EPISODE_STEPS
from glassgait.models.task.gait import Gait
from glassgait.studies.common.console import console, say
from glassgait.studies.common.experiment import Report
from glassgait.studies.common.play import Steps, pusher
from glassgait.studies.common.policies import OneGait
from glassgait.studies.common.rollouts import REPORTED_SEEDS
from glassgait.studies.common.run_folder import open_run
from glassgait.studies.common.tables import json_records, print_table
from glassgait.studies.deployment.drive.dropout import silence_controllers
from glassgait.studies.deployment.drive.packet_loss import lose_packets
from glassgait.studies.deployment.drive.processes import Record, RobotProcess, control
from glassgait.studies.view.command import OwnCommand
from glassgait.studies.view.live import first_interrupt

Link = Annotated[LinkSettings, tyro.conf.arg(name="")]

PATIENCE = 2.0
"""Time in which a message that is sent here must come back (s)."""


@dataclass(frozen=True)
class DriveController(OneGait):
    """Answer what a robot in another process senses, until Ctrl-C.

    Attributes:
        policy: `expert`, a kind of student, or the path of a policy file.
        link: Where messages go.
    """

    title: ClassVar[str] = "drive controller"

    policy: str = "expert"
    link: Link = field(default_factory=LinkSettings)

    def run(self) -> None:
        """Answers, and reports what was counted."""
        found = self.policies()
        gait, policy = found.gait, found.controller(self.policy)
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
        n_steps: Control steps to simulate; without end by default.
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
    n_steps: Steps | None = None
    patience: Annotated[NotNegative, Le(1.0)] = 0.0
    watchdog: Watchdog = field(default_factory=Watchdog)
    link: Link = field(default_factory=LinkSettings)
    seed: Seed = 0
    output: Path | None = None

    def run(self) -> None:
        """Simulates, and reports what was counted."""
        gait, scenario = find_gait(self.gait), load_scenario(self.scenario)
        if self.robot is not None:
            scenario = replace(scenario, robot=self.robot)
        if self.meshcat:
            scenario = replace(scenario, command=SliderCommand())
        else:
            scenario = self.command.over(scenario)
        lcm = open_lcm(self.link)
        inputs = {"gait": gait.digest(), "world": scenario.digest()}
        opened = (
            open_run(self.output, study=self.title, settings=self, inputs=inputs, resume=False)
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
            with first_interrupt() as interrupted:
                record = process.run(self.n_steps, interrupted)
            if self.output:
                Report({"link": _table(record)}, record).write(self.output)
        print_table(f"{gait.name}: the robot", _table(record))
        if self.output:
            console.print(f"written to {self.output}")


@dataclass(frozen=True)
class _Study(OneGait):
    """Robots whose link fails, in one process and simulated time.

    Attributes:
        policy: `expert`, a kind of student, or the path of a policy file.
        scenario: Name of a scenario that ships, or path of a scenario file.
        watchdog: How long robots wait for their controller.
        resume: Continue the run that the folder holds.
        output: Folder of the results.
    """

    table: ClassVar[str]
    """Name of the table's files."""

    heading: ClassVar[str]

    policy: str = "expert"
    scenario: str = TRAINING
    watchdog: Watchdog = field(default_factory=Watchdog)
    resume: bool = False
    output: Path | None = None

    @abstractmethod
    def measure(
        self, gait: Gait, controller: AlternatingController, scenario: Scenario, folder: Path
    ) -> pd.DataFrame:
        """Lets robots walk, and counts."""

    def run(self) -> None:
        """Measures, and writes the table."""
        found, scenario = self.policies(), load_scenario(self.scenario)
        gait, controller = found.gait, found.controller(self.policy)
        folder = self.output or found.output(self.title) / Path(self.policy).stem
        inputs = {
            "gait": gait.digest(),
            "world": scenario.digest(),
            "expert": controller.expert.digest(),
            "policy": controller.policy.digest(),
        }
        run = {"study": self.title, "settings": self, "inputs": inputs, "resume": self.resume}
        with open_run(folder, **run):
            table = self.measure(gait, controller, scenario, folder)
            Report({self.table: table}, json_records(table)).write(folder)
        print_table(f"{gait.name}, {self.policy}: {self.heading}", table)
        console.print(f"written to {folder}")


@dataclass(frozen=True)
class DrivePacketLoss(_Study):
    """Lose messages on purpose, in one process and simulated time, and count what happens.

    Results are in runs/drive/packet-loss/<gait>/<policy> by default.

    Attributes:
        n_robots: Robots of each trial.
        n_steps: Control steps of each robot.
        seed: Seed of commands, noise and losses.
    """

    title: ClassVar[str] = "drive packet-loss"
    table: ClassVar[str] = "losses"
    heading: ClassVar[str] = "lost and late messages"

    n_robots: Count = 26
    n_steps: Count = EPISODE_STEPS
    seed: Seed = REPORTED_SEEDS[0]

    def measure(
        self, gait: Gait, controller: AlternatingController, scenario: Scenario, folder: Path
    ) -> pd.DataFrame:
        return lose_packets(
            gait,
            controller,
            scenario,
            folder / "trials",
            n_robots=self.n_robots,
            n_steps=self.n_steps,
            watchdog=self.watchdog,
            seed=self.seed,
        )


@dataclass(frozen=True)
class DriveDropout(_Study):
    """Silence controllers for good at many moments of the stride, and count the falls.

    Robots go at thirds of the fastest speed of distillation, whatever the scenario commands.
    Results are in runs/drive/dropout/<gait>/<policy> by default.

    Attributes:
        n_moments: Robots of each speed; each loses its controller at another moment.
        push: What is added to the trunk's velocity at that moment, in a drawn direction (m/s).
        n_steps: Control steps from then to the end.
        seed: Seed of dwell, turning, noise, initial states and pushes.
    """

    title: ClassVar[str] = "drive dropout"
    table: ClassVar[str] = "silence"
    heading: ClassVar[str] = "silent for good"

    n_moments: Count = 32
    push: Annotated[NotNegative, Le(20.0)] = 0.0
    n_steps: Annotated[int, Ge(5), Le(3000)] = 100
    seed: Seed = 2000

    def measure(
        self, gait: Gait, controller: AlternatingController, scenario: Scenario, folder: Path
    ) -> pd.DataFrame:
        return silence_controllers(
            gait,
            controller,
            scenario,
            n_moments=self.n_moments,
            push=self.push,
            n_steps=self.n_steps,
            watchdog=self.watchdog,
            seed=self.seed,
        )


def _table(record: Record) -> pd.DataFrame:
    return pd.DataFrame({"what": record.keys(), "value": record.values()})


def open_lcm(link: LinkSettings) -> DrakeLcm:
    """Opens LCM, and tries whether messages come through.

    Drake goes on without a word where a URL cannot be used, and messages go nowhere.

    Raises:
        InputError: if a message does not come back.
    """
    lcm = DrakeLcm(link.lcm_url)
    # On a channel of its own moment, so that others that start now do not answer in its place.
    channel, heard = f"{link.channels}PROBE_{time.time_ns()}", []
    subscription = lcm.Subscribe(channel, heard.append)
    end = time.monotonic() + PATIENCE
    while not heard and time.monotonic() < end:
        lcm.Publish(channel, b"probe")
        lcm.HandleSubscriptions(100)
    del subscription
    if not heard:
        raise InputError(
            f"link: no message comes through at {shown(link.lcm_url)}; check that this machine "
            "takes multicast on its loopback, that a server of tcpq runs, or give another --lcm-url"
        )
    return lcm
