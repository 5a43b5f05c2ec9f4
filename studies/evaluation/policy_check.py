"""`glassgait policy check`: let a network of another project walk, and look for mistakes."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
import pandas as pd
import tyro
from joblib import delayed

from glassgait.diagrams.batch import BatchSimulator
from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.physics import make_physics
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.station import StationConfig
from glassgait.models.arrays import Array
from glassgait.models.policies.controller import Controller
from glassgait.models.policies.described import DescribedPolicy, Description, load_described
from glassgait.models.robots import kinematics
from glassgait.models.robots.quadruped import JOINTS, LEG_JOINTS, LEGS
from glassgait.models.settings import Count, Settings, checked
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.command import Command
from glassgait.models.task.gait import load_gait, shipped_gait
from glassgait.models.task.reward_machine import BoolArray
from glassgait.models.task.termination import PHYSICAL_FALL
from glassgait.models.task.terrain import Terrain
from glassgait.studies.common.console import console, say
from glassgait.studies.common.episode import PreparedTask, episode
from glassgait.studies.common.experiment import REPORTED_SEEDS
from glassgait.studies.common.jobs import Workers, run_parallel
from glassgait.studies.common.tables import print_table

COMMANDS = {
    "forward 0.5 m/s": (0.5, 0.0, 0.0),
    "forward 1.0 m/s": (1.0, 0.0, 0.0),
    "backward 0.5 m/s": (-0.5, 0.0, 0.0),
    "left 0.3 m/s": (0.0, 0.3, 0.0),
    "yaw 0.8 rad/s": (0.0, 0.0, 0.8),
    "0.5 m/s and 0.5 rad/s": (0.5, 0.0, 0.5),
    "0.5 m/s up 10°": (0.5, 0.0, 0.0),
}
"""Commanded speeds forward and to the left (m/s) and yaw rate (rad/s); the last is on a slope."""

PAIRS = {"trot": ((0, 3), (1, 2)), "pace": ((0, 2), (1, 3)), "bound": ((0, 1), (2, 3))}
"""Indices in `LEGS` of the legs that step together."""

SPEEDS = "speed (m/s)", "left (m/s)", "yaw (rad/s)"  # titles of columns
STATE_STEPS = "steps per RM state"  # title of a column, in control steps
LEAST_TOGETHER = 0.5  # smallest correlation of contacts of legs that step together
LEAST_THREES = 0.5  # smallest share of a walk's control steps on exactly three feet
STEPS = 500  # control steps of each robot
SETTLED = 100  # control steps after which speeds are measured
TRIED_ROBOTS, TRIED_STEPS = 8, 250  # size of the rollouts that try mistakes
CURVE = (0.5, 0.0, 0.5)  # command, as in `COMMANDS`, with which variants are compared
BETTER = 0.1  # smallest difference of errors that counts (m/s and rad/s, added)


@checked
class CheckPolicy(Settings):
    """Check the description of a network, let robots walk with it, and look for mistakes.

    Prints a row per engine and command: commanded → measured speeds, physical falls (trunk or thigh
    on the ground, or a lean over 60°), the share of time that each foot is on the ground, the gait,
    and the mean duration of its RM states. Then tries variants of the description, each with one
    frequent mistake undone, and prints those that walk better, the best one first.

    Attributes:
        description: YAML file that describes the network; see models/policies/README.md.
        n_robots: Number of robots per command.
    """

    title: ClassVar[str] = "policy check"

    description: Annotated[Path, tyro.conf.Positional]
    n_robots: Count = 26

    def run(self) -> None:
        """Checks the description, and prints a table for both engines."""
        policy = load_described(self.description)
        length, size = policy.description.history.length, policy.description.frame_size
        console.print(
            f"{self.description}: valid, {length} × {size} numbers, digest {policy.digest()}"
        )
        stations = StationConfig(engine="mujoco", time_step=0.002), StationConfig()
        mujoco, drake = (delayed(walked)(policy, station, self.n_robots) for station in stations)
        # Drake takes longest, so it begins first.
        work: list[Any] = [drake, mujoco, delayed(found_mistakes)(policy, stations[0])]
        with Workers().pool():
            *tables, sentences = run_parallel(work)
        table = pd.concat(reversed(tables))
        print_table(f"{self.n_robots} robots, {STEPS * CONTROL_PERIOD:g} s", table)
        for sentence in sentences:
            say(sentence)


def walked(
    policy: DescribedPolicy, station: StationConfig, n_robots: int, n_steps: int = STEPS
) -> pd.DataFrame:
    """Lets robots follow each command in one engine, and returns one row per command.

    Speeds are means over the robots that do not fall, after the first two seconds. A command to the
    left beyond `commands.left` is left out.
    """
    least, greatest = policy.description.commands.left
    asked = {
        title: given
        for title, given in COMMANDS.items()
        if given[1] == 0.0 or least <= given[1] <= greatest
    }
    slope = replace(station, terrain=Terrain(slope=10.0))
    stations = [*[station] * (len(asked) - 1), slope]
    commands = np.repeat(list(asked.values()), n_robots, axis=0)
    fell, velocity, contact = _rolled_out(policy, stations, commands, n_steps)
    rows = []
    for i, (title, command) in enumerate(asked.items()):
        robots = np.arange(i * n_robots, (i + 1) * n_robots)
        up = robots[~fell[robots]]
        gait = recognized(contact[:, up]) if len(up) else "none"
        stance = contact[:, robots].mean(axis=(0, 1))
        reached = velocity[:, up].mean(axis=(0, 1)) if len(up) else np.full(3, np.nan)
        speeds = [f"{a:.2f} → {b:.2f}" for a, b in zip(command, reached, strict=True)]
        rows.append(
            {
                "physics": station.engine,
                "command": title,
                **dict(zip(SPEEDS, speeds, strict=True)),
                "falls": int(fell[robots].sum()),
                f"stance {' '.join(LEGS)}": " ".join(f"{share:.2f}" for share in stance),
                "gait": gait,
                STATE_STEPS: state_steps(gait, contact[:, up]),
            }
        )
    return pd.DataFrame(rows)


def recognized(contact: BoolArray) -> str:
    """Returns trot, pace, bound, walk or none, recognized from contacts (T, n, 4) of n robots."""
    stance = contact.reshape(-1, len(LEGS)).astype(float)
    if (stance.std(axis=0) == 0.0).any():
        return "none"  # A foot never steps.
    together = np.corrcoef(stance.T)
    for gait, pairs in PAIRS.items():
        if all(together[pair] >= LEAST_TOGETHER for pair in pairs):
            return gait
    return "walk" if (stance.sum(axis=1) == len(LEGS) - 1).mean() >= LEAST_THREES else "none"


def state_steps(gait: str, contact: BoolArray) -> float:
    """Returns the mean duration of a gait's RM states (control steps); NaN for `none`.

    The strongest frequency of the contacts (T, n, 4) is taken for that of the stride.
    """
    if gait == "none":
        return np.nan
    n = 10 * len(contact)  # padded, for more frequencies
    spectrum = np.fft.rfft(contact - contact.mean(axis=0), n, axis=0)
    power = np.square(np.abs(spectrum)).sum(axis=(1, 2))
    return round(n / float(power.argmax()) / shipped_gait(gait).n_states, 1)


def found_mistakes(policy: DescribedPolicy, station: StationConfig) -> list[str]:
    """Tries each variant in a curve, and returns sentences on the better ones, best first."""
    described, better = _curve_error(policy, station), []
    for mistake, variant in variants(policy.description):
        error = _curve_error(policy.with_description(variant), station)
        # A variant that only falls or stands is no better.
        if error < min(described, sum(CURVE)) - BETTER:
            better.append((error, mistake))
    sentences = [
        f"{mistake} walks better: error {error:.2f} instead of {described:.2f} (m/s and rad/s, "
        "added); check the description"
        for error, mistake in sorted(better)
    ]
    return sentences or [f"the description walks best: error {described:.2f}"]


def variants(description: Description) -> Iterator[tuple[str, Description]]:
    """Yields titles and descriptions, each with one frequent mistake undone.

    The mistakes concern the joint order, gravity's sign, the scale of yaw and the history's order.
    """
    unitree = tuple(f"{leg}_{joint}" for leg in ("FR", "FL", "RR", "RL") for joint in LEG_JOINTS)
    by_kind = tuple(f"{leg}_{joint}" for joint in LEG_JOINTS for leg in LEGS)
    for joints in (JOINTS, unitree, by_kind):
        if joints != description.joints:
            yield f"the order {', '.join(joints[:4])}, …", replace(description, joints=joints)
    for i, term in enumerate(description.observation):
        scale = np.broadcast_to(np.asarray(term.scale, dtype=float), term.size)
        others = {"gravity of the other sign": -scale} if term.term == "gravity" else {}
        if term.term == "command":
            factors = [factor for factor in (0.25, 1.0, 2.0) if factor != scale[-1]]
            others = {f"a yaw command scaled by {f:g}": [*scale[:2], f] for f in factors}
        for title, other in others.items():
            terms = [*description.observation]
            terms[i] = replace(term, scale=tuple(map(float, other)))
            yield title, replace(description, observation=tuple(terms))
    history = description.history
    if history.length > 1:
        order = "newest_first" if history.order == "oldest_first" else "oldest_first"
        by = "term" if history.by == "frame" else "frame"
        for changed in (replace(history, order=order), replace(history, by=by)):
            title = f"a history {changed.order} by {changed.by}"
            yield title, replace(description, history=changed)


def _curve_error(policy: DescribedPolicy, station: StationConfig) -> float:
    """Returns the mean error of forward speed (m/s) plus yaw rate (rad/s) of robots in a curve.

    A robot that falls counts as standing still.
    """
    commands = np.tile(CURVE, (TRIED_ROBOTS, 1))
    fell, velocity, _ = _rolled_out(policy, [station], commands, TRIED_STEPS)
    reached = np.where(fell[:, None], 0.0, velocity.mean(axis=0))
    return float(np.abs(reached - commands)[:, [0, 2]].sum(axis=1).mean())


def _rolled_out(
    policy: DescribedPolicy, stations: list[StationConfig], commands: Array, n_steps: int
) -> tuple[BoolArray, Array, BoolArray]:
    """Rolls out robots with constant commands (n, 3; see `COMMANDS`), split evenly among stations.

    Returns which robots fell (n,), and after the first two seconds the trunks' forward speed, speed
    to the left and yaw rate (T, n, 3; m/s, rad/s) and the feet's contacts (T, n, 4).
    """
    gait, n = load_gait(policy.gait), len(commands)
    controller = Controller(policy.commanded_left(commands[:, 1]))
    scenario = Scenario(
        station=stations[0], command=FixedCommand(), sensor_noise=0.0, limits=PHYSICAL_FALL
    )
    driven = (station.with_gains(policy.robot, policy.joint_law) for station in stations)
    world = PreparedTask.of(gait, scenario, controller)
    world = world._replace(physics=make_physics(policy.robot, *driven))
    velocity, contact = [], []

    def command_and_record(step: int, simulator: BatchSimulator) -> None:
        if step == 0:
            simulator.set_command(Command(commands[:, [0, 2]], np.full(n, float(gait.dwell[0]))))
        if step >= SETTLED:
            linear, angular = kinematics.base_velocity(simulator.state.plant)
            velocity.append(np.concatenate([linear[:, :2], angular[:, 2:]], axis=1))
            contact.append(simulator.state.touching)

    seed, events = REPORTED_SEEDS[0], [command_and_record]
    end = episode(gait, controller, world, n_robots=n, n_steps=n_steps, seed=seed, events=events)
    return end.fell < n_steps, np.array(velocity), np.array(contact)
