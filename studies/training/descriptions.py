"""`glassgait gait` and `glassgait robot`: check descriptions of gaits and robots."""

from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
import tyro

from glassgait.diagrams.station import StationConfig
from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.files import write_atomically
from glassgait.models.policies.library import find_gait
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import DEFAULT_ROBOT, Robot
from glassgait.models.settings import Settings, checked
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.drawing import to_mermaid, to_text
from glassgait.models.task.gait import gait_names
from glassgait.studies.common.console import console

if TYPE_CHECKING:
    from pydrake.multibody.tree import SpatialInertia


@dataclass(frozen=True)
class ShowGait:
    """Check a gait file and draw its reward machine.

    Attributes:
        output: Markdown file for the drawing, in Mermaid's language.
    """

    gait: Annotated[str, tyro.conf.Positional] = "trot"
    output: Path | None = None

    def run(self) -> None:
        """Checks and draws."""
        gait = find_gait(self.gait)
        console.print(
            f"{gait.name}: valid, {gait.n_states} states; up to {gait.max_speed:g} m/s and "
            f"{gait.max_yaw_rate:g} rad/s, {gait.dwell[0]} to {gait.dwell[1]} control steps a state"
        )
        console.print(to_text(gait), soft_wrap=True)
        if self.output is not None:
            write_atomically(self.output, f"```mermaid\n{to_mermaid(gait)}```\n")
            console.print(f"drawn in {self.output}")
        elif gait.name not in gait_names():
            console.print(f"train: glassgait train --gait {quote(self.gait)}", soft_wrap=True)


STATIONS = (StationConfig(), StationConfig(time_step=0.002, engine="mujoco"))
"""Physics in which a robot must stand."""

DROP = 0.03
"""Height from which a robot is dropped (m)."""

STEPS = round(4.0 / CONTROL_PERIOD)
"""Control steps until it must be at rest."""

MOST_SAG = 0.2
"""Greatest share of the stance's height by which a standing robot may sag."""

MOST_SWAY = 5e-3
"""Greatest vertical movement of the trunk in the last second (m)."""

MOST_LEAN = 10.0
"""Greatest lean of the trunk (°)."""

SAME = 1e-6
"""Greatest relative difference of masses and inertias between the simulators."""


@checked
class CheckRobot(Settings):
    """Check a robot description, by its name or the path of a robot.yaml, and let it stand."""

    title: ClassVar[str] = "robot"

    robot: Annotated[str, tyro.conf.Positional] = DEFAULT_ROBOT

    def run(self) -> None:
        """Checks the files, and drops the robot in its default stance."""
        import pandas as pd

        from glassgait.studies.common.tables import print_table

        robot = load_robot(self.robot)
        check_inertias(robot, *inertias(robot))
        console.print(
            f"{robot.full_name}: {robot.mass:.3f} kg; Drake and MuJoCo agree on the mass, the "
            f"centre and the inertia of all {1 + quadruped.N_JOINTS} links"
        )
        rows = [stand(robot, station) for station in STATIONS]
        print_table(f"{robot.full_name}: dropped in its stance", pd.DataFrame(rows))
        for row in rows:
            if problem := problem_of(row):
                where = f"{robot.path}: the robot does not stand in {row['physics']}"
                raise InputError(f"{where}: {problem}")


def inertias(robot: Robot) -> tuple[dict[str, Array], dict[str, Array]]:
    """Returns masses (kg), centres (m) and inertias about them (kg·m²) of the links (13 numbers
    each), as Drake and as MuJoCo compile them."""
    from pydrake.systems.framework import DiagramBuilder

    from glassgait.diagrams.mujoco_physics import make_model
    from glassgait.diagrams.station import AddStation

    drake, mujoco = STATIONS
    plant, _, instance = AddStation(DiagramBuilder(), robot, drake)
    model = make_model(robot, mujoco)
    by_drake, by_mujoco = {}, {}
    for link in ("trunk", *quadruped.JOINTS):
        inertia = plant.GetBodyByName(link, instance).default_spatial_inertia()
        by_drake[link] = numbers_of(inertia)
        body = model.body(link)
        axes = kinematics.rotation_matrix(body.iquat)
        moments = axes @ np.diag(body.inertia) @ axes.T
        by_mujoco[link] = np.concatenate([body.mass, body.ipos, moments.ravel()])
    return by_drake, by_mujoco


def numbers_of(inertia: "SpatialInertia") -> Array:
    """Returns mass, centre and the inertia about it of what Drake holds (13)."""
    centre = inertia.get_com()
    moments = inertia.Shift(centre).CalcRotationalInertia().CopyToFullMatrix3()
    return np.concatenate([[inertia.get_mass()], centre, moments.ravel()])


def check_inertias(robot: Robot, drake: dict[str, Array], mujoco: dict[str, Array]) -> None:
    """Refuses a robot that differs between the simulators, or from its file, by naming the link."""
    for link, found in drake.items():
        for what, part in (("mass", slice(1)), ("centre", slice(1, 4)), ("inertia", slice(4, 13))):
            difference = np.abs(found[part] - mujoco[link][part]).max()
            if not difference <= SAME * np.abs(found[part]).max():
                raise InputError(
                    f"{robot.urdf_path}: the {what} of link {link} differs by {difference:.3g} "
                    "between Drake and MuJoCo; mend its inertial"
                )
    total = sum(numbers[0] for numbers in drake.values())
    if not abs(total - robot.mass) <= SAME * robot.mass:
        raise InputError(
            f"{robot.urdf_path}: its links have {robot.mass:g} kg, and {total:g} kg in Drake; mend "
            "their inertials"
        )


def stand(robot: Robot, station: StationConfig) -> dict[str, str | float]:
    """Drops a robot in its default stance and measures how it stands in the end."""
    from glassgait.diagrams.physics import make_physics

    # Let it fall from a little above, and come to rest.
    state = kinematics.standing_state(robot)[None]
    stance = state[0, quadruped.POSITION][2]
    state[:, quadruped.POSITION.stop - 1] += DROP
    physics = make_physics(robot, station)
    physics.set_friction(np.array([station.friction]))
    heights = []
    for _ in range(STEPS):
        state, touching = physics.step(state, robot.default_stance[None])
        heights.append(state[0, quadruped.POSITION][2])

    # The torque that the stance takes, and the rest in the end.
    torque = robot.joint_torque(
        target=robot.default_stance,
        position=state[0, quadruped.JOINT_POSITION],
        velocity=state[0, quadruped.JOINT_VELOCITY],
        gains=station.gains(robot),
    )
    return {
        "physics": station.engine,
        "height (m)": float(heights[-1]),
        "sag / height": float(1.0 - heights[-1] / stance),
        "sway (m)": float(np.ptp(heights[-round(1.0 / CONTROL_PERIOD) :])),
        "lean (°)": float(kinematics.lean(state[0, quadruped.QUATERNION])),
        "torque / greatest": float(np.max(np.abs(torque) / robot.effort)),
        "feet": int(touching[0].sum()),
    }


def problem_of(row: dict[str, str | float]) -> str:
    """Returns what keeps a robot from standing and how to mend it; empty if it stands."""
    keys = ("height (m)", "sag / height", "sway (m)", "lean (°)", "feet")
    height, sag, sway, lean, feet = (float(row[key]) for key in keys)
    if not np.isfinite(height):
        return "the physics cannot be computed; check masses and inertias in the URDF"
    if lean > MOST_LEAN:
        return f"it leans by {lean:.0f}°; move the stance's feet below its weight"
    if sag > MOST_SAG:
        return f"it sags by {sag:.0%} of its height; give more stiffness"
    if sway > MOST_SWAY:
        return f"it moves by {sway:.3f} m a second; give more damping"
    if feet < quadruped.N_LEGS:
        return f"{feet:.0f} of {quadruped.N_LEGS} feet touch; make the legs' stances alike"
    return ""
