"""`glassgait robot`: makes a robot of a description, or checks one, and lets it stand."""

import re
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
import pandas as pd
import tyro

from glassgait.diagrams.description_reader import FORMATS, read_description
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import make_simulator
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.standing import STATIONS, Standing, stand
from glassgait.diagrams.visualization import open_meshcat
from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.files import read_text, write_atomically
from glassgait.models.robots import quadruped
from glassgait.models.robots.description import WRITTEN, urdf
from glassgait.models.robots.found_robot import FoundRobot
from glassgait.models.robots.library import ROBOT_FILE, load_robot, read_robot, robot_names
from glassgait.models.robots.proposal import (
    MOMENTS,
    Entry,
    mean_of_legs,
    propose,
    robot_text,
)
from glassgait.models.robots.quadruped import LEG_JOINTS, LEGS
from glassgait.models.robots.robot import DEFAULT_ROBOT, NAME, Robot, RobotName
from glassgait.models.robots.urdf_comparison import LARGEST_DESCRIPTION
from glassgait.models.settings import Settings
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import load_gait
from glassgait.studies.common.console import console, say
from glassgait.studies.common.play import first_interrupt
from glassgait.studies.common.tables import print_table

NEGLIGIBLE, SMALL = 1e-3, 1e-3
"""Greatest relative difference of numbers that count as equal, and what the least ones are taken
for: files round them."""


@dataclass(frozen=True)
class MakeRobot(Settings):
    """Make a robot of a description in URDF or MJCF, or check one, and let it stand.

    Attributes:
        robot: Description of a quadruped in URDF or MJCF, of which a robot.yaml is made; or a
            robot.yaml, or the name of a robot that ships, which is checked.
        name: Name of the robot that is made; that of the description by default.
        output: Folder of the robot that is made; robots/<name> by default.
        against: Another robot, or another description: its numbers stand beside.
        meshcat: Show the robot as it stands in Meshcat, until Ctrl-C.
    """

    title: ClassVar[str] = "robot"

    robot: Annotated[str, tyro.conf.Positional] = DEFAULT_ROBOT
    name: RobotName | None = None
    output: Path | None = None
    against: str | None = None
    meshcat: bool = False

    def run(self) -> None:
        """Makes, checks, compares and shows the robot."""
        path = Path(self.robot)
        if path.suffix.lower() in FORMATS:
            path = self._make(path)
        elif self.name is not None or self.output is not None:
            raise InputError(
                f"{self.robot}: --name and --output are of robots that are made of a description; "
                "leave them out, or give a URDF or an MJCF"
            )
        robot = _checked(str(path))
        if self.against is not None:
            _compare(robot, self.against)
        _stands(robot)
        if self.meshcat:
            _show(robot)

    def _make(self, description: Path) -> Path:
        """Writes the robot's file, and returns its path."""
        name = self.name or re.sub("[^a-z0-9_]", "_", description.stem.lower())
        if not re.match(NAME, name):
            raise InputError(
                f"{description}: its name does not begin with a letter, or is longer than 40; give "
                "one with --name"
            )
        if name in robot_names():
            raise InputError(f"--name {name}: is a robot that ships; give another name")
        folder = self.output or Path("robots") / name
        path = folder / ROBOT_FILE
        if path.exists():
            raise InputError(
                f"{path}: is there already; check it by 'glassgait robot {path}', or give another "
                "--output"
            )
        found = read_description(description)
        entries = propose(found, name)
        write_atomically(path, robot_text(found, entries))
        print_table(f"{name}: read from {description}", _table_of(entries))
        console.print(f"written to {path}")
        if missing := [entry.key for entry in entries if entry.source == "missing"]:
            raise InputError(
                f"{path}: {', '.join(missing)} are not in {description.name}; fill them in, then "
                f"'glassgait robot {path}'"
            )
        return path


def _table_of(entries: list[Entry]) -> pd.DataFrame:
    rows = [
        {"key": own.key, "value": own.value.strip() if "\n" not in own.value else "…"}
        | {"source": own.source, "unit": own.comment}
        for own in entries
    ]
    return pd.DataFrame(rows)


def _checked(robot: str) -> Robot:
    """Loads a robot; writes its URDF first, where that is missing or was written here."""
    path = Path(robot)
    if path.suffix in (".yaml", ".yml"):
        own = read_robot(path.resolve())
        described = own.urdf_path
        if not described.exists() or WRITTEN in read_text(described, LARGEST_DESCRIPTION):
            write_atomically(described, urdf(own))
            say(f"written to {described}")
    return load_robot(robot)


def _stands(robot: Robot) -> None:
    standings = [stand(robot, station) for station in STATIONS]
    print_table(f"{robot.full_name}: dropped in its stance", _table_of_standing(standings))
    for standing in standings:
        if standing.failure:
            raise InputError(
                f"{robot.path}: the robot does not stand in {standing.engine}: {standing.failure}"
            )


def _table_of_standing(standings: list[Standing]) -> pd.DataFrame:
    titles = {
        "engine": "physics",
        "height": "height (m)",
        "sag": "sag (m)",
        "sway": "sway (m)",
        "lean": "lean (°)",
        "torque": "torque / greatest",
        "feet": "feet",
        "failure": "failure",
    }
    return pd.DataFrame([asdict(own) for own in standings]).rename(columns=titles)


def _compare(robot: Robot, other: str) -> None:
    """Prints the numbers that differ between a robot's description and another one."""
    path = Path(other)
    theirs_at = path if path.suffix.lower() in FORMATS else load_robot(other).urdf_path
    ours, theirs = (_numbers(read_description(own)) for own in (robot.urdf_path, theirs_at))
    silent = sorted({key.partition(",")[2] or key for key in ours if np.isnan(theirs[key]).all()})
    rows = []
    for key, own in ours.items():
        differs = np.abs(theirs[key] - own) > NEGLIGIBLE * np.maximum(np.abs(own), SMALL)
        if not differs.any():
            continue
        alike = np.ptp(own) == np.ptp(theirs[key]) == 0.0
        for leg, pair in zip(LEGS, zip(own, theirs[key], strict=True), strict=False):
            label = key if alike else f"{leg}, {key}"
            rows.append({"number": label, robot.name: pair[0], other: pair[1]})
            if alike:
                break
    print_table(f"what differs, of {len(ours)} kinds of numbers", pd.DataFrame(rows))
    if silent:
        say(f"{other} is silent on:{','.join(silent)}")


def _numbers(found: FoundRobot) -> dict[str, Array]:
    """Returns what a description says, of the robot (1,) or of each leg (4,); NaN for nothing."""
    numbers = {"mass (kg)": found.mass}
    bodies = {"trunk": found.trunk_inertia}
    bodies |= {kind: mean_of_legs(found, part) for part, kind in enumerate(LEG_JOINTS)}
    for name, body in bodies.items():
        numbers[f"{name}, mass (kg)"] = body.mass
        for axis, own in zip("xyz", body.center, strict=True):
            numbers[f"{name}, centre {axis} (m)"] = own
        numbers |= {f"{name}, {key} (kg·m²)": getattr(body, key) for key in MOMENTS}
    legs = list(found.legs.values())
    each: dict[str, list[float | None]] = {
        "hip offset x (m)": [abs(leg.hip[0]) for leg in legs],
        "hip offset y (m)": [abs(leg.hip[1]) for leg in legs],
        "thigh offset (m)": [abs(leg.outward) for leg in legs],
        "thigh length (m)": [leg.thigh_length for leg in legs],
        "calf length (m)": [leg.calf_length for leg in legs],
        "foot radius (m)": [leg.foot_radius for leg in legs],
    }
    for part, kind in enumerate(LEG_JOINTS):
        each |= {
            f"{kind}, least angle (rad)": [leg.limits[part, 0] for leg in legs],
            f"{kind}, greatest angle (rad)": [leg.limits[part, 1] for leg in legs],
            f"{kind}, torque (N·m)": [leg.effort[part] for leg in legs],
            f"{kind}, velocity (rad/s)": [leg.velocity[part] for leg in legs],
        }
    return {key: np.atleast_1d(np.array(own, float)) for key, own in (numbers | each).items()}


def _show(robot: Robot) -> None:
    """Lets the robot stand in Meshcat at real time, until Ctrl-C."""
    meshcat = open_meshcat()
    scenario = replace(Scenario(), robot=robot.source)
    diagram = MakeLocomotion(load_gait("trot"), scenario, meshcat=meshcat)
    simulator = make_simulator(diagram, realtime_rate=1.0)
    port = diagram.GetInputPort("actions")
    port.FixValue(simulator.get_mutable_context(), np.zeros(quadruped.N_JOINTS))
    say(f"open {meshcat.web_url()}; Ctrl-C ends")
    with first_interrupt() as interrupted:
        while not interrupted():
            simulator.AdvanceTo(simulator.get_context().get_time() + CONTROL_PERIOD)
