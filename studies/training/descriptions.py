"""`glassgait gait` and `glassgait robot`: check the descriptions of gaits and robots."""

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
        output: Markdown file for a Mermaid drawing.
    """

    gait: Annotated[str, tyro.conf.Positional] = "trot"
    output: Path | None = None

    def run(self) -> None:
        """Checks the gait and draws its reward machine."""
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
"""Stations in which a robot must stand."""

DROP = 0.03
"""Height from which a robot is dropped (m)."""

STEPS = round(4.0 / CONTROL_PERIOD)
"""Control steps after which it must be at rest."""

MOST_SAG = 0.2
"""Greatest share of the stance's height by which a standing robot may sag."""

MOST_SWAY = 5e-3
"""Greatest vertical movement of the trunk in the last second (m)."""

MOST_LEAN = 10.0
"""Greatest lean of the trunk (°)."""

TOLERANCE = 1e-6
"""Greatest relative difference of masses and inertias between the simulators."""

QUANTITIES = {"mass": slice(1), "centre": slice(1, 4), "inertia": slice(4, 13)}


@checked
class CheckRobot(Settings):
    """Check a robot description, by its name or the path of a robot.yaml, and let it stand."""

    title: ClassVar[str] = "robot"

    robot: Annotated[str, tyro.conf.Positional] = DEFAULT_ROBOT

    def run(self) -> None:
        """Checks the files and drops the robot in its default stance."""
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
            if problem := standing_problem(row):
                prefix = f"{robot.path}: the robot does not stand in {row['physics']}"
                raise InputError(f"{prefix}: {problem}")


def inertias(robot: Robot) -> tuple[dict[str, Array], dict[str, Array]]:
    """Returns mass (kg), centre (m) and inertia about the centre (kg·m²) of each link (13 numbers),
    in Drake and in MuJoCo."""
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
    """Returns mass, centre and inertia about the centre (13) of Drake's spatial inertia."""
    centre = inertia.get_com()
    moments = inertia.Shift(centre).CalcRotationalInertia().CopyToFullMatrix3()
    return np.concatenate([[inertia.get_mass()], centre, moments.ravel()])


def check_inertias(robot: Robot, drake: dict[str, Array], mujoco: dict[str, Array]) -> None:
    """Raises an InputError if a robot differs between the simulators, or from its file."""
    for link, values in drake.items():
        for name, entries in QUANTITIES.items():
            difference = np.abs(values[entries] - mujoco[link][entries]).max()
            if not difference <= TOLERANCE * np.abs(values[entries]).max():
                raise InputError(
                    f"{robot.urdf_path}: the {name} of link {link} differs by {difference:.3g} "
                    "between Drake and MuJoCo; correct its inertial element"
                )
    total = sum(values[0] for values in drake.values())
    if not abs(total - robot.mass) <= TOLERANCE * robot.mass:
        raise InputError(
            f"{robot.urdf_path}: its links have {robot.mass:g} kg, but {total:g} kg in Drake; "
            "correct their inertial elements"
        )


def stand(robot: Robot, station: StationConfig) -> dict[str, str | float]:
    """Drops a robot in its default stance and measures its final pose."""
    from glassgait.diagrams.physics import make_physics

    # Drop the robot and let it come to rest.
    state = kinematics.standing_state(robot)[None]
    stance = state[0, quadruped.POSITION][2]
    state[:, quadruped.POSITION.stop - 1] += DROP
    physics = make_physics(robot, station)
    physics.set_friction(np.array([station.friction]))
    heights = []
    for _ in range(STEPS):
        state, touching = physics.step(state, robot.default_stance[None])
        heights.append(state[0, quadruped.POSITION][2])

    # Measure the torques of the stance and the final pose.
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


def standing_problem(row: dict[str, str | float]) -> str:
    """Returns why a robot does not stand, with a remedy; empty if it stands."""
    keys = ("height (m)", "sag / height", "sway (m)", "lean (°)", "feet")
    height, sag, sway, lean, feet = (float(row[key]) for key in keys)
    if not np.isfinite(height):
        return "the simulation diverges; check masses and inertias in the URDF"
    if lean > MOST_LEAN:
        return f"it leans by {lean:.0f}°; move the stance's feet below its centre of mass"
    if sag > MOST_SAG:
        return f"it sags by {sag:.0%} of its height; raise the stiffness"
    if sway > MOST_SWAY:
        return f"it moves by {sway:.3f} m in a second; raise the damping"
    if feet < quadruped.N_LEGS:
        return f"{feet:.0f} of {quadruped.N_LEGS} feet touch; give all legs the same stance height"
    return ""
