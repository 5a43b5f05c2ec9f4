"""Rolling robots out over a day: they rise from their bellies, stand, walk, and lie down again."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from glassgait.diagrams.scenario import Scenario
from glassgait.models.arrays import Array
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.command import Command, sample_commands
from glassgait.models.task.day import DAMP, POLICY, STANCE, Day
from glassgait.models.task.gait import Gait
from glassgait.models.task.reward_machine import BoolArray, IntArray
from glassgait.studies.common.episode import (
    ControlStep,
    Observer,
    episode,
    give,
    lie,
    push,
    request_mode,
)

LYING_ERROR = 0.2
"""Greatest difference of a joint at the start from the posture of the mode before rest (rad)."""

STANDS, WALKS, HALTS, WALKS_AGAIN, LIES, ENDS = 50, 320, 620, 770, 970, 1170
"""Control steps at which the operator requests it: to stand up, walk, stand by a command of 0, walk
again, lie down, and the end (1 s, 6.4 s, …, 23.4 s). Robots that do not walk lie down at `WALKS`.
"""

PUSHED = 470
"""Control step at which robots are pushed, while they walk (9.4 s)."""

LANDED = 25
"""Control steps in a mode at the stance after which feet are to stay where they are (0.5 s)."""


@dataclass(frozen=True)
class RobotsDay:
    """Robots that live through a day.

    Attributes:
        day: Their day.
        gait: The gait in which they walk.
        controller: What acts then.
        scenario: Where they are; its limits say what a fall is where they stand and walk.
        n_robots: Number of robots.
        seed: Seed of poses, commands, pushes and noise.
        push: Horizontal velocity that is added to each trunk once, to a side that is drawn (m/s).
        walks: Whether they are requested to walk.
    """

    day: Day
    gait: Gait
    controller: AlternatingController
    scenario: Scenario
    n_robots: int
    seed: int
    push: float = 0.0
    walks: bool = True


class _Log(NamedTuple):
    """What n robots did over T control steps.

    Attributes:
        mode: Numbers of the modes (T, n).
        failed: Whether any failure showed (T, n).
        plant: Plant states x after each step (T, n, 37).
        touching: Whether each foot touches then (T, n, 4).
        torque: Greatest torque of a joint then (T, n; N·m).
    """

    mode: IntArray
    failed: BoolArray
    plant: Array
    touching: BoolArray
    torque: Array


def roll_day(job: RobotsDay) -> pd.DataFrame:
    """Rolls a job's robots out over their day.

    Returns:
        A row a robot. `fell`: whether it showed a failure where it was to stand or walk, or was
        damped; `fell_in`: the mode in which it first did. `risen`: time from the request to the
        first mode at the stance (s). `standing`: share of the control steps with all four feet in
        contact, of those at the stance from half a second on; `foot_movement`: the farthest that a
        foot moved over the ground in these (mm). `torque_<mode>`: the greatest (N·m). `leaned`: the
        greatest lean of the trunk (°); `damped`: whether it ever was. `end`: the mode at the end;
        `end_height` (m), `end_lean` (°).
    """
    n = job.n_robots
    generator = np.random.default_rng(job.seed)
    first, second = (sample_commands(job.gait, n, generator) for _ in range(2))
    angle = generator.uniform(-np.pi, np.pi, n)
    velocity = job.push * np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=1)
    errors = generator.uniform(-LYING_ERROR, LYING_ERROR, (n, quadruped.N_JOINTS))
    zero = Command(np.zeros((n, 2)), first.dwell)

    events = [
        lie(job.controller.robot, job.day, errors),
        give(0, zero),
        request_mode(STANDS, "stand"),
    ]
    if job.walks:
        events += [request_mode(WALKS, "walk"), give(WALKS, first), give(HALTS, zero)]
        events += [give(WALKS_AGAIN, second)]
    lies, ends = (LIES, ENDS) if job.walks else (WALKS, WALKS + ENDS - LIES)
    events += [request_mode(lies, "sit")]
    if job.push:
        events += [push(PUSHED, velocity)]
    recorder = _Recorder(job)
    episode(
        job.gait,
        job.controller,
        job.scenario,
        n_robots=n,
        n_steps=ends,
        seed=generator,
        observers=[recorder],
        events=events,
        when_fallen="go on",
        day=job.day,
    )
    return _scores(job, recorder.log)


class _Recorder(Observer):
    """Records what is scored."""

    def __init__(self, job: RobotsDay) -> None:
        self._robot = job.controller.robot
        self._law = job.scenario.joint_law(job.controller)
        self._rows: list[_Log] = []

    def observe(self, step: ControlStep) -> None:
        assert step.modes is not None
        plant = step.after.plant
        torque = self._law.torque(
            self._robot,
            action=step.after.action,
            position=plant[:, quadruped.JOINT_POSITION],
            velocity=plant[:, quadruped.JOINT_VELOCITY],
        )
        failed = np.asarray(step.outcome.failures.any(axis=1))
        greatest = np.abs(torque).max(axis=1)
        self._rows.append(_Log(step.modes.state.mode, failed, plant, step.after.touching, greatest))

    @property
    def log(self) -> _Log:
        """All steps."""
        return _Log(*(np.array(values) for values in zip(*self._rows, strict=True)))


def _scores(job: RobotsDay, log: _Log) -> pd.DataFrame:
    day, names = job.day, np.array(job.day.names)
    joints = np.array([day.modes[name].joints for name in day.names])[log.mode]
    stands = _risen(day, names[log.mode])
    fallen = (log.failed & (stands | (joints == POLICY))) | (
        log.mode == day.names.index(day.damped)
    )
    landed = _for_long(stands, LANDED)
    lean = kinematics.lean(log.plant[..., quadruped.QUATERNION])
    feet = kinematics.world_feet(job.controller.robot, log.plant)[..., :2]
    rows = []
    for i in range(job.n_robots):
        own = landed[:, i]
        fell, begun = fallen[:, i], np.flatnonzero(stands[STANDS:, i])
        torques = {
            f"torque_{name}": float(log.torque[log.mode[:, i] == number, i].max(initial=0.0))
            for number, name in enumerate(day.names)
            if day.modes[name].joints != DAMP
        }
        rows.append(
            {
                "robot": i,
                "fell": bool(fell.any()),
                "fell_in": _fell_in(names[log.mode[:, i]], fell, day),
                "risen": CONTROL_PERIOD * begun[0] if len(begun) else float("nan"),
                "standing": float(log.touching[own, i].all(axis=1).mean()) if own.any() else 0.0,
                "foot_movement": 1000.0 * _movement(feet[:, i], own),
                **torques,
                "leaned": float(lean[:, i].max()),
                "damped": bool((log.mode[:, i] == day.names.index(day.damped)).any()),
                "end": str(names[log.mode[-1, i]]),
                "end_height": float(log.plant[-1, i, quadruped.POSITION][2]),
                "end_lean": float(lean[-1, i]),
            }
        )
    return pd.DataFrame(rows)


def _risen(day: Day, modes: Any) -> BoolArray:
    """Returns where robots are to stand (T, n): at the stance, in a mode that leads to walking."""
    walking = {name for name, mode in day.modes.items() if mode.joints == POLICY}
    standing = [
        name for name, mode in day.modes.items() if mode.joints == STANCE and walking & {*mode.next}
    ]
    return np.isin(modes, standing)


def _fell_in(modes: Any, fell: BoolArray, day: Day) -> str:
    """Returns the mode in which a robot first fell (T,), the one before it was damped."""
    if not fell.any():
        return ""
    first = int(np.argmax(fell))
    return str(modes[first - 1] if modes[first] == day.damped and first else modes[first])


def _for_long(holds: BoolArray, n_steps: int) -> BoolArray:
    """Returns where something has held (T, n) for so many control steps."""
    steps, result = np.zeros(holds.shape[1:], dtype=np.int64), np.zeros_like(holds)
    for step, now in enumerate(holds):
        steps = np.where(now, steps + 1, 0)
        result[step] = steps > n_steps
    return result


def _movement(feet: Array, still: BoolArray) -> float:
    """Returns the farthest that a foot (T, 4, 2; m) is from where it was as a stay began (m)."""
    begins = still & ~np.concatenate([[False], still[:-1]])
    stay = np.cumsum(begins)
    farthest = 0.0
    for number in range(1, int(stay.max(initial=0)) + 1):
        own = feet[still & (stay == number)]
        farthest = max(farthest, float(np.linalg.norm(own - own[0], axis=-1).max()))
    return farthest
