"""`glassgait gait` and `glassgait robot`: check the files of gaits and robots."""

from dataclasses import dataclass, replace
from pathlib import Path
from shlex import quote
from typing import Annotated, ClassVar

import numpy as np
import tyro

from glassgait.diagrams.station import StationConfig
from glassgait.models.errors import InputError
from glassgait.models.files import write_atomically
from glassgait.models.policies.described import load_described
from glassgait.models.policies.library import find_gait
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import DEFAULT_ROBOT, JointLaw, Robot
from glassgait.models.settings import Settings, checked
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.drawing import to_text
from glassgait.models.task.gait import FREE, gait_lines, gait_names, parse_formula, shipped_gait
from glassgait.studies.common.console import console


@dataclass(frozen=True)
class ShowGait:
    """Check a gait file and draw its reward machine.

    Attributes:
        gait: Name of a gait, or path of a gait file.
        watch: Description of a network (see models/policies/README.md). Instead of checking `gait`,
            recognize the network's gait at 0.5 m/s, and write a gait file beside the description.
            Its RM states may end after half of the measured steps.
    """

    gait: Annotated[str, tyro.conf.Positional] = "trot"
    watch: Path | None = None

    def run(self) -> None:
        """Checks the gait, or the one recognized with `watch`, and draws its reward machine."""
        gait = find_gait(path := self.gait if self.watch is None else watched_gait(self.watch))
        console.print(
            f"{gait.name}: valid, {gait.n_states} states; up to {gait.max_speed:g} m/s and "
            f"{gait.max_yaw_rate:g} rad/s, {gait.dwell[0]} to {gait.dwell[1]} control steps a state"
        )
        console.print(to_text(gait), soft_wrap=True)
        if self.watch is not None:
            command = f"distill --gait {quote(path)} --expert {quote(str(self.watch))}"
            console.print(f"distil: glassgait {command}", soft_wrap=True)
        elif gait.name not in gait_names():
            console.print(f"train: glassgait train --gait {quote(path)}", soft_wrap=True)


def watched_gait(description: Path) -> str:
    """Recognizes a network's gait and writes it to a file; returns its path, or `free` for none.

    A network follows no commanded foot clearance or steps. Therefore a transition in the file fires
    once its standing feet touch the ground and any other foot is in the air, at the earliest after
    half of the measured steps.
    """
    from glassgait.studies.evaluation.policy_check import STATE_STEPS, walked

    # Recognize the gait.
    seen = walked(load_described(description), STATIONS[1], WATCHED).iloc[0]
    name, steps = seen["gait"], seen[STATE_STEPS]
    if name == "none":
        console.print(f"{description}: no gait is recognized; students get no phase")
        return FREE
    console.print(f"{description}: {name}, {steps:g} control steps per RM state")

    # Write the shipped gait with other transitions.
    gait, half, edges = shipped_gait(name), max(1, round(steps / 2)), []
    for edge in gait.transitions:
        feet = edge.when.text.split(" & ")
        down, up = ([foot for foot in feet if (foot[0] == "~") == lifted] for lifted in (0, 1))
        when = f"{' & '.join(down)} & ({' | '.join(up)})"
        edges.append(replace(edge, when=parse_formula(when)))
    gait = replace(gait, transitions=tuple(edges), dwell=(half, half), clearance=LOW)
    path = description.with_name(f"{description.stem}_{name}.yaml")
    if path.exists():
        raise InputError(f"{path}: exists; remove it to watch the robots again")
    write_atomically(path, "\n".join(gait_lines(gait)) + "\n")
    return str(path)


WATCHED = 4  # robots per command from which a gait is recognized
LOW = 1e-3  # smallest clearance that a gait may have (m)

STATIONS = (StationConfig(), StationConfig(time_step=0.002, engine="mujoco"))
"""Simulations, in Drake and MuJoCo, in which a robot must stand."""

DROP = 0.03  # height from which a robot is dropped (m)
STEPS = round(4.0 / CONTROL_PERIOD)  # control steps after which it must be at rest
MOST_SAG = 0.2  # largest sag of a standing robot, as a share of the stance's height
MOST_SWAY = 5e-3  # largest vertical movement of the trunk in the last second (m)
MOST_LEAN = 10.0  # largest lean of the trunk (°)


@checked
class CheckRobot(Settings):
    """Check a robot and let it stand.

    Attributes:
        robot: Name of a robot, or path of its robot.yaml.
    """

    title: ClassVar[str] = "robot"

    robot: Annotated[str, tyro.conf.Positional] = DEFAULT_ROBOT

    def run(self) -> None:
        """Checks the files and drops the robot in its default stance."""
        import pandas as pd

        from glassgait.studies.common.tables import print_table

        robot = load_robot(self.robot)
        console.print(f"{robot.full_name}: {robot.mass:.3f} kg")
        rows = [stand(robot, station) for station in STATIONS]
        print_table(f"{robot.full_name}: dropped in its stance", pd.DataFrame(rows))
        for row in rows:
            if problem := standing_problem(row):
                prefix = f"{robot.path}: the robot does not stand in {row['physics']}"
                raise InputError(f"{prefix}: {problem}")


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
    torque = JointLaw(station.gains(robot)).torque(
        robot,
        action=np.zeros(quadruped.N_JOINTS),
        position=state[0, quadruped.JOINT_POSITION],
        velocity=state[0, quadruped.JOINT_VELOCITY],
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
