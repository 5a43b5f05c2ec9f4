"""Whether a robot stands: dropped in its default stance, it must come to rest on its feet."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from glassgait.diagrams.engines import make_physics
from glassgait.diagrams.physics import Physics, PhysicsStep
from glassgait.diagrams.station import StationConfig
from glassgait.models.arrays import Array
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task import CONTROL_PERIOD

DROP = 0.03
"""Height from which a robot is dropped (m)."""

SECONDS = 4.0
"""Time it has, of which the last second counts (s)."""

MOST_SAG = 0.2
"""Greatest share of the stance's height by which a robot that stands may sag."""

MOST_SWAY = 5e-3
"""Greatest rise and fall of a trunk that is at rest, in a second (m)."""

MOST_LEAN = 10.0
"""Greatest lean of a trunk that stands (°)."""

STATIONS = (StationConfig(), StationConfig(time_step=0.002, engine="mujoco"))


@dataclass(frozen=True)
class Standing:
    """How a robot stands.

    Attributes:
        engine: What computed it.
        height: Of the trunk (m).
        sag: By how much the trunk is lower than with joints at the stance's angles (m).
        sway: Greatest less least height in the last second (m).
        lean: Angle of the trunk's vertical axis to the world's (°).
        torque: Greatest torque of a joint, over its motor's.
        feet: Number of feet that touch the ground.
        failure: What keeps it from standing; empty if it stands.
    """

    engine: str
    height: float
    sag: float
    sway: float
    lean: float
    torque: float
    feet: int
    failure: str = ""


def settle(robot: Robot, physics: Physics, states: Array, n_steps: int) -> Iterator[PhysicsStep]:
    """Lets robots come to rest in their stance, and gives what each control step brings.

    Args:
        robot: What robots they are.
        physics: What computes it.
        states: Their plants' states (m, 37).
        n_steps: Control steps.
    """
    targets = np.tile(robot.default_stance, (len(states), 1))
    for _ in range(n_steps):
        moved = physics.step(states, targets)
        states = moved.states
        yield moved


def stand(robot: Robot, station: StationConfig) -> Standing:
    """Drops a robot in its default stance, and lets it come to rest."""
    state = kinematics.standing_state(robot)[None]
    stance = float(state[0, quadruped.POSITION][2])
    state[:, quadruped.POSITION.stop - 1] += DROP
    physics = make_physics(robot, station)
    physics.set_friction(np.array([station.friction]))
    steps = list(settle(robot, physics, state, round(SECONDS / CONTROL_PERIOD)))
    heights = [float(moved.states[0, quadruped.POSITION][2]) for moved in steps]
    moved = steps[-1]
    last = moved.states[0]
    torque = robot.joint_torque(
        target=robot.default_stance,
        position=last[quadruped.JOINT_POSITION],
        velocity=last[quadruped.JOINT_VELOCITY],
        gains=station.gains(robot),
    )
    standing = Standing(
        engine=station.engine,
        height=heights[-1],
        sag=stance - heights[-1],
        sway=float(np.ptp(heights[-round(1.0 / CONTROL_PERIOD) :])),
        lean=float(kinematics.lean(last[quadruped.QUATERNION])),
        torque=float(np.max(np.abs(torque) / robot.effort)),
        feet=int(moved.touching[0].sum()),
    )
    return replace(standing, failure=_failure(standing, stance))


def _failure(standing: Standing, stance: float) -> str:
    if not np.isfinite(standing.height):
        return "the physics cannot be computed"
    if standing.lean > MOST_LEAN:
        return f"it leans by {standing.lean:.0f}°; move the stance's feet below its weight"
    if standing.sag > MOST_SAG * stance:
        return f"it sags by {standing.sag:.3f} m of {stance:.3f} m; give more stiffness"
    if standing.sway > MOST_SWAY:
        return f"it moves by {standing.sway:.3f} m a second; give more damping"
    if standing.feet < quadruped.N_LEGS:
        return f"{standing.feet} of {quadruped.N_LEGS} feet touch; make the legs' stances alike"
    return ""
