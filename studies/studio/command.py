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
        scenario: Name of a scenario that ships, or path of a scenario file, in Drake.
        seed: Seed of the sensors' noise and of pushes.
        port: Port of the page on this machine; 0 for any free port.
        output: Folder of saved formulas; runs/studio/<gait> by default.
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
        # Imported here: Drake takes seconds to import, and errors of the command line come first.
        from glassgait.studies.studio.live_robot import LiveRobot  # noqa: PLC0415
        from glassgait.studies.studio.session import EditSession  # noqa: PLC0415

        # Check the policy and the scenario before the page opens.
        policies, name = self.find()
        gait, policy = policies.gait, policies.formulas(name)
        scenario = load_scenario(self.scenario)
        if scenario.station.engine != "drake":
            raise InputError(
                f"--scenario {self.scenario}: the studio simulates in Drake; name another scenario"
            )
        # This command holds until the page's sliders change it.
        dwell = sum(gait.dwell) // 2
        scenario = replace(scenario, command=FixedCommand(0.0, 0.0, dwell))
        folder = self.output or policies.output(self.title)
        refuse_run(folder)
        # Bind the port first, to refuse a used one before Drake builds the diagram.
        with _listening(HOST, self.port) as listening:
            controller = policies.controller(name)
            robot = LiveRobot(gait, scenario, controller, seed=self.seed)
            session = EditSession(policy, policies.expert)
            save_as = folder / f"{policies.file(name).stem}_edited"
            try:
                port = listening.getsockname()[1]
                console.print(f"open http://{HOST}:{port} in a browser; Ctrl-C here ends it")
                serve(robot, session, gait, save_as, listening)
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
