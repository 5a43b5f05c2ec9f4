"""`glassgait drive`: a robot and its controller in two processes, and what becomes of losses."""

import time
from abc import abstractmethod
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, ClassVar, Literal

import numpy as np
import pandas as pd
import tyro
from annotated_types import Ge, Le
from pydrake.geometry import Meshcat
from pydrake.lcm import DrakeLcm

from glassgait.diagrams.acting import Acting, CompiledActing, PolicyActing
from glassgait.diagrams.answering import AnsweringEnd
from glassgait.diagrams.commands import SliderCommand
from glassgait.diagrams.link import ControllerEnd, RobotEnd
from glassgait.diagrams.meshcat_operator import MeshcatOperator
from glassgait.diagrams.scenario import TRAINING, Scenario, load_scenario
from glassgait.diagrams.simulated_robot import SimulatedRobot
from glassgait.diagrams.unitree_controller_end import UnitreeControllerEnd
from glassgait.diagrams.unitree_robot_end import UnitreeRobotEnd
from glassgait.diagrams.visualization import open_meshcat
from glassgait.models.errors import InputError, shown
from glassgait.models.export.contract import Contract
from glassgait.models.link.channels import LinkSettings
from glassgait.models.link.dds import (
    STATES,
    DdsSettings,
    open_controllers_end,
    open_robots_end,
)
from glassgait.models.link.operator import Asked, Operator, RemoteOperator
from glassgait.models.link.remote import Sticks
from glassgait.models.link.supervision import Supervision
from glassgait.models.link.watchdog import Watchdog
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.policies.library import find_gait
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import Robot
from glassgait.models.settings import Count, NotNegative, Seed, Settings
from glassgait.models.task import EPISODE_STEPS
from glassgait.models.task.command import Command, check_command
from glassgait.models.task.day import REQUESTS, day_of, load_day
from glassgait.models.task.gait import Gait
from glassgait.models.task.request import RequestGate
from glassgait.studies.common.console import console, say
from glassgait.studies.common.experiment import Report
from glassgait.studies.common.play import Steps, first_interrupt, pusher
from glassgait.studies.common.policies import EXPERT, OneGait, PolicySource
from glassgait.studies.common.rollouts import REPORTED_SEEDS
from glassgait.studies.common.run_folder import open_run
from glassgait.studies.common.tables import json_records, print_table
from glassgait.studies.deployment.drive.dropout import silence_controllers
from glassgait.studies.deployment.drive.look import look
from glassgait.studies.deployment.drive.packet_loss import lose_packets
from glassgait.studies.deployment.drive.processes import Record, RobotProcess, control
from glassgait.studies.deployment.export.files import load_contract
from glassgait.studies.view.command import OwnCommand

Wire = Literal["lcm", "unitree"]

Request = Literal["sit", "stand", "walk"]

Dds = Annotated[DdsSettings, tyro.conf.arg(name="")]

Link = Annotated[LinkSettings, tyro.conf.arg(name="")]

PATIENCE = 2.0
"""Time in which a message that is sent here must come back (s)."""


@dataclass(frozen=True)
class DriveController(PolicySource):
    """Answer what a robot in another process senses, until Ctrl-C.

    Attributes:
        gait: Name of a gait, or path of a gait file; `trot` by default. Of a contract of several
            gaits, the one that runs; where the remote or Meshcat commands, the first one does by
            default, until R1, L1 or a button changes it.
        policy: `expert`, which is the default, a kind of student, or the path of a policy file.
        robot: Name of a robot, or path of its robot.yaml; by default that of the policies, or of
            the contract.
        day: The robot's day, in some of whose modes the policy acts: `day`, which ships, or path of
            a day's file; by default the policy always acts. Beside a contract, the file of its day,
            where that does not ship.
        contract: A `deploy.yaml` that `export` wrote: the C file beside it is compiled, and acts in
            place of a gait and a policy of Python's. Only take one that you trust: it is a program.
        wire: `lcm`, or `unitree` for Unitree's own messages over DDS, by which this end drives the
            motors: it lets the robot rise first, and damps it when anything is wrong.
        link: Where messages go over LCM.
        dds: Where Unitree's go.
        command: What the robot is to do, over Unitree's wire, where the robot's end sends no
            command. By default it steps on the spot in the middle of the gait's rhythm.
        request: What is requested of a day, over Unitree's wire; `stand` by default.
        remote: Take speed, yaw rate and requests from the robot's own remote, over Unitree's wire.
            Its buttons L2 and B damp the robot in any case.
        meshcat: Take them from sliders, buttons and a gamepad in Meshcat, over Unitree's wire.
        sticks: How the remote's sticks command.
        supervision: When joints are damped, over Unitree's wire.
        look: Send nothing, and print once a second what a robot on Unitree's wire senses.
    """

    title: ClassVar[str] = "drive controller"

    gait: str | None = None
    policy: str | None = None
    day: str | None = None
    contract: Path | None = None
    wire: Wire = "lcm"
    link: Link = field(default_factory=LinkSettings)
    dds: Dds = field(default_factory=DdsSettings)
    command: OwnCommand = field(default_factory=OwnCommand)
    request: Request | None = None
    remote: bool = False
    meshcat: bool = False
    sticks: Sticks = field(default_factory=Sticks)
    supervision: Supervision = field(default_factory=Supervision)
    look: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.contract is not None:
            for name in ("policy", "source"):
                if getattr(self, name) is not None:
                    raise InputError(
                        f"{self.title}: {name} is the contract's; leave --{name} out, or --contract"
                    )
        if self.wire == "lcm" and self.look:
            raise InputError(f"{self.title}: look is for Unitree's wire; add --wire unitree")
        commanded = self.command != OwnCommand() or self.request is not None
        if self.wire == "lcm" and (self.remote or self.meshcat or commanded):
            raise InputError(
                f"{self.title}: over LCM the robot's end sends the command; give it there, or "
                "--wire unitree here"
            )
        if self.remote and (
            (self.command.speed, self.command.yaw_rate, self.request) != (None, None, None)
        ):
            raise InputError(
                f"{self.title}: speed, yaw rate and requests come from the remote; leave --remote, "
                "or --command.speed, --command.yaw-rate and --request out"
            )
        if self.meshcat and (self.remote or commanded):
            raise InputError(
                f"{self.title}: commands come from Meshcat; leave --meshcat, or --remote, "
                "--command and --request out"
            )

    def run(self) -> None:
        """Answers, and reports what was counted."""
        with ExitStack() as stack:
            if self.contract is None:
                (acting, shown), first = self._policy(), 0
            else:
                folder = Path(stack.enter_context(TemporaryDirectory()))
                acting, first = self._compiled(self.contract, folder)
                shown = str(self.contract)
            if self.look:
                self._look(acting.robot)
                return
            controller, heard = self._end(acting, first)
            say(f"listening on {heard}; Ctrl-C ends")
            with first_interrupt() as interrupted:
                record = control(controller, interrupted)
        print_table(f"{shown}: the controller", _table(record))

    def _policy(self) -> tuple[PolicyActing, str]:
        """Finds the policy that acts, and what it is called."""
        found = self.policies_of(OneGait.gait if self.gait is None else self.gait)
        name = self.policy or EXPERT
        policy = found.controller(name)
        day = None if self.day is None else load_day(self.day)
        return PolicyActing(policy.robot, found.gait, policy, day), f"{found.gait.name}, {name}"

    def _compiled(self, contract: Path, folder: Path) -> tuple[CompiledActing, int]:
        """Loads the controller of a contract; its compiled file goes into a folder.

        Returns:
            The controller, and the number of its gait that runs at first.
        """
        asked = None if self.robot is None else load_robot(self.robot)
        found, compiled, robot = load_contract(contract, folder, asked)
        first = self._first_gait(found)
        say(f"{contract}: is the {robot.full_name}'s, {found.policy} of {', '.join(found.gaits)}")
        day = day_of(found.day) if self.day is None else load_day(self.day)
        if compiled.has_day and day is None and (self.remote or self.meshcat):
            say(
                "its day does not ship, so every request is taken once the robot follows; name its "
                "file with --day"
            )
        return CompiledActing(robot, compiled, found, day), first

    def _first_gait(self, found: Contract) -> int:
        """Returns the number of a contract's gait that runs at first.

        Raises:
            InputError: if the gait or the day is not the contract's, or none of several gaits is
                chosen where one is to run.
        """
        given = None if self.gait is None else find_gait(self.gait, self.robot or found.robot)
        if given is not None and found.gaits.get(given.name) != given.digest():
            raise InputError(
                f"{self.title}: gait {shown(self.gait)} is not the contract's; leave --gait out, "
                f"or name {' or '.join(found.gaits)}"
            )
        if self.day is not None and load_day(self.day).digest() != found.day:
            raise InputError(
                f"{self.title}: day {shown(self.day)} is not the contract's; leave --day out, or "
                "--contract"
            )
        needs_one = not (self.remote or self.meshcat or self.look)
        if len(found.gaits) > 1 and given is None and needs_one:
            raise InputError(
                f"{self.title}: the contract has several gaits; name the one that is to run, with "
                f"--gait {' or '.join(found.gaits)}, or change them over Unitree's wire, with "
                "--remote or --meshcat"
            )
        return 0 if given is None else list(found.gaits).index(given.name)

    def _end(self, acting: Acting, gait: int) -> tuple[AnsweringEnd, str]:
        """Returns the controller's end, and where it listens.

        Args:
            acting: What answers.
            gait: Number of its gait that runs at first.
        """
        if self.wire == "lcm":
            end = ControllerEnd(acting, open_lcm(self.link), self.link.names, gait=gait)
            return end, self.link.names.sensors
        operator = self._operator(acting, gait)
        end = UnitreeControllerEnd(
            acting,
            open_controllers_end(self.dds),
            operator=operator,
            supervision=self.supervision,
        )
        return end, f"{STATES} of domain {self.dds.domain} at {self.dds.interface}"

    def _look(self, robot: Robot) -> None:
        endpoint = open_controllers_end(self.dds)
        with first_interrupt() as interrupted:
            counts = look(robot, endpoint, interrupted).counts
        record = counts.rows("states", timed=True) | {"messages of another kind": counts.foreign}
        print_table(f"{robot.full_name}: what was heard", _table(record))

    def _operator(self, acting: Acting, gait: int) -> Operator:
        """Returns what asks the robot, whose gait of a number runs at first.

        Raises:
            InputError: if a mode is requested of a controller without a day, or the command is
                beyond the gait's range.
        """
        check_command(acting.limits, ", ".join(acting.gaits), **self.command.given)
        if self.request is not None and not acting.has_day:
            raise InputError(f"{self.title}: a request is of a day; add --day day, or leave it out")
        gate = RequestGate(acting.day) if acting.has_day else None
        if self.meshcat:
            meshcat = open_meshcat()
            say(f"open {meshcat.web_url()}, and steer under 'Open Controls'")
            return MeshcatOperator(acting.limits, meshcat, gaits=acting.gaits, gait=gait, gate=gate)
        own = self.command
        dwell = float(sum(acting.limits.dwell) // 2 if own.dwell is None else own.dwell)
        if self.remote:
            n_gaits = len(acting.gaits)
            return RemoteOperator(acting.limits, self.sticks, dwell, n_gaits, gate, gait=gait)
        velocity = np.array([own.speed or 0.0, own.yaw_rate or 0.0])
        requested = REQUESTS.index(self.request or "stand")
        asked = Asked(Command(velocity, np.array(dwell)), requested, gait)
        return lambda *_: asked


@dataclass(frozen=True)
class DriveSimulator(Settings):
    """Simulate a robot at real time that a controller in another process moves, until Ctrl-C.

    Attributes:
        wire: `lcm`, or `unitree` for Unitree's own messages over DDS, by which the controller's end
            lets the robot rise, commands and damps it.
        gait: Name of a gait, or path of a gait file: commands are made for it.
        robot: Name of a robot, or path of its robot.yaml; by default the scenario's.
        scenario: Name of a scenario that ships, or path of a scenario file.
        command: The command, in place of the scenario's; what is left out is the scenario's. A
            scenario that names no command asks for 0.5 m/s.
        day: Over LCM, the day that the robot is to live through: `day`, which ships, or path of a
            day's file. It begins on its belly, damped, and is not put back on its feet; the
            controller has its `--day` as well, or one in its contract.
        request: What is requested of the day; `stand` by default.
        meshcat: Show the robot in Meshcat; over LCM take commands, and requests of a day, from
            sliders, buttons and a gamepad there.
        n_steps: Control steps to simulate; without end by default.
        patience: Time to wait for the answer to each message of sensors (s): answers that come by
            then act at once. By default none is waited for, and answers act at the next step of
            the plant, as on a robot.
        watchdog: How long the robot waits for its controller, over LCM.
        link: Where messages go over LCM.
        dds: Where Unitree's go.
        seed: Seed of the sensors' noise, of pushes and of drawn commands.
        output: New folder for what was counted; only printed by default.
    """

    title: ClassVar[str] = "drive simulator"

    wire: Wire = "lcm"
    gait: str = "trot"
    robot: str | None = None
    scenario: str = TRAINING
    command: OwnCommand = field(default_factory=OwnCommand)
    day: str | None = None
    request: Request | None = None
    meshcat: bool = False
    n_steps: Steps | None = None
    patience: Annotated[NotNegative, Le(1.0)] = 0.0
    watchdog: Watchdog = field(default_factory=Watchdog)
    link: Link = field(default_factory=LinkSettings)
    dds: Dds = field(default_factory=DdsSettings)
    seed: Seed = 0
    output: Path | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        days = (self.day, self.request) != (None, None)
        if self.wire == "unitree" and (self.command != OwnCommand() or days):
            raise InputError(
                f"{self.title}: over Unitree's wire the controller's end has the command and the "
                "day; give them there, or --wire lcm here"
            )
        if self.meshcat and self.command != OwnCommand():
            raise InputError(
                f"{self.title}: commands come from Meshcat; leave --meshcat or --command out"
            )
        if self.request is not None and (self.day is None or self.meshcat):
            raise InputError(
                f"{self.title}: a request is of a day, and not of Meshcat's buttons; add --day day "
                "and leave --meshcat out, or leave --request out"
            )

    def run(self) -> None:
        """Simulates, and reports what was counted."""
        gait, scenario = find_gait(self.gait, self.robot), load_scenario(self.scenario)
        if self.robot is not None:
            scenario = replace(scenario, robot=self.robot)
        if self.wire == "lcm":
            sliders = replace(scenario, command=SliderCommand(attended=True))
            scenario = sliders if self.meshcat else self.command.over(scenario)
        inputs = {"gait": gait.digest(), "world": scenario.digest()}
        opened = (
            open_run(self.output, study=self.title, settings=self, inputs=inputs, resume=False)
            if self.output
            else nullcontext()
        )
        with opened:
            meshcat = open_meshcat() if self.meshcat else None
            robot = self._robot(gait, scenario, meshcat)
            if meshcat is not None:
                sliders = ", and move the sliders under 'Open Controls'"
                say(f"open {meshcat.web_url()}{sliders if self.wire == 'lcm' else ''}")
            pushed = pusher(robot.simulator, scenario, self.seed)
            process = RobotProcess(robot, patience=self.patience, pushed=pushed)
            with first_interrupt() as interrupted:
                record = process.run(self.n_steps, interrupted)
            if self.output:
                Report({"link": _table(record)}, record).write(self.output)
        print_table(f"{gait.name}: the robot", _table(record))
        if self.output:
            console.print(f"written to {self.output}")

    def _robot(self, gait: Gait, scenario: Scenario, meshcat: Meshcat | None) -> SimulatedRobot:
        """Opens the robot's end."""
        if self.wire == "unitree":
            endpoint = open_robots_end(self.dds)
            robot = UnitreeRobotEnd(scenario, endpoint, seed=self.seed, meshcat=meshcat)
            sent = f"{STATES} of domain {self.dds.domain} at {self.dds.interface}"
        else:
            day = None if self.day is None else load_day(self.day)
            robot = RobotEnd(
                gait,
                scenario,
                open_lcm(self.link),
                self.link.names,
                watchdog=self.watchdog,
                session=time.time_ns(),
                seed=self.seed,
                meshcat=meshcat,
                day=day,
            )
            if day is not None and meshcat is None:
                robot.request_mode(self.request or "stand")
            sent = self.link.names.sensors
        say(f"sending on {sent}, waiting for a controller; Ctrl-C ends")
        return robot


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
