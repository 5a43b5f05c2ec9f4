"""`glassgait studio`: changes formulas while a robot walks by them."""

import socket
from dataclasses import replace
from pathlib import Path
from typing import Annotated, ClassVar

from annotated_types import Ge, Le

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.scenario import NOMINAL_SCENARIO, load_scenario
from glassgait.models.errors import InputError
from glassgait.models.settings import Seed, checked
from glassgait.studies.common.console import console
from glassgait.studies.common.run import refuse_run
from glassgait.studies.distillation.students import OnePolicy

MISSING = "the studio needs NiceGUI; install it with pip install 'glassgait[studio]'"


@checked
class OpenStudio(OnePolicy):
    """Edit a formula in the browser while the robot walks by it.

    Attributes:
        policy: A kind of student, or path of a file, whose policy is made of formulas; by default
            the student with the fewest terms.
        scenario: Name of a scenario that ships, or path of a scenario file, in which the robot
            begins; of a discrete plant in Drake.
        seed: Seed of the sensors' noise and of pushes.
        port: Port of the page on this machine; 0 is any that is free.
        output: Folder of what is saved; runs/studio/<gait> by default.
    """

    title: ClassVar[str] = "studio"

    scenario: str = NOMINAL_SCENARIO
    seed: Seed = 0
    port: Annotated[int, Ge(0), Le(65535)] = 8080
    output: Path | None = None

    def run(self) -> None:
        try:
            # Imported here: NiceGUI is optional, and no other command needs it.
            from glassgait.studies.studio.page import HOST, serve  # noqa: PLC0415
        except ModuleNotFoundError as error:
            if (error.name or "").partition(".")[0] not in ("nicegui", "fastapi", "uvicorn"):
                raise
            raise InputError(MISSING) from error
        # Imported here: Drake takes seconds, and mistakes of the command line come before it.
        from glassgait.studies.studio.live_robot import LiveRobot  # noqa: PLC0415
        from glassgait.studies.studio.session import EditSession  # noqa: PLC0415

        # The policy and the scenario are checked before the page opens.
        found, name = self.find()
        policy = found.formulas(name)
        scenario = load_scenario(self.scenario)
        if scenario.accuracy is not None or scenario.station.engine != "drake":
            raise InputError(
                f"--scenario {self.scenario}: the studio walks on discrete plants of Drake; name "
                "a scenario without accuracy and engine, such as nominal"
            )
        # The page steers; this command holds until it does.
        dwell = sum(found.gait.dwell) // 2
        scenario = replace(scenario, command=FixedCommand(0.0, 0.0, dwell))
        folder = self.output or found.output(self.title)
        refuse_run(folder)
        # The port is bound first: a taken one is refused before Drake builds anything.
        with _listening(HOST, self.port) as listening:
            controller = found.controller(name)
            robot = LiveRobot(found.gait, scenario, controller, seed=self.seed)
            session = EditSession(policy, found.expert)
            save_as = folder / f"{found.file(name).stem}_edited"
            try:
                port = listening.getsockname()[1]
                console.print(f"open http://{HOST}:{port} in a browser; Ctrl-C here ends it")
                serve(robot, session, found.gait, save_as, listening)
            finally:
                robot.stop()


def _listening(host: str, port: int) -> socket.socket:
    listening = socket.socket()
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((host, port))
    except OSError as error:
        listening.close()
        raise InputError(
            f"--port {port}: is taken ({error.strerror}); name another one, or 0 for any"
        ) from error
    listening.listen()
    return listening
