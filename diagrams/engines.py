"""The physics of many robots, by the engine that their station names."""

from glassgait.diagrams.batch_physics import BatchPhysics
from glassgait.diagrams.physics import Physics
from glassgait.diagrams.station import StationConfig
from glassgait.models.errors import InputError
from glassgait.models.robots.robot import Robot


def make_physics(robot: Robot, *stations: StationConfig) -> Physics:
    """Makes the physics of groups of robots.

    Args:
        robot: What robots they are.
        stations: Physics of each group, all of one engine.

    Raises:
        InputError: if a station is continuous, their engines differ, or MuJoCo is not installed.
    """
    engines = {station.engine for station in stations}
    if len(engines) > 1:
        raise InputError(f"stations: engines are {' and '.join(sorted(engines))}; name one")
    if engines == {"drake"}:
        return BatchPhysics(robot, *stations)
    try:
        # Imported here: MuJoCo is an extra.
        from glassgait.diagrams.mujoco_physics import MujocoPhysics  # noqa: PLC0415
    except ImportError as error:
        raise InputError(
            "station: engine is 'mujoco', which is not installed; run pip install "
            "'glassgait[mujoco]'"
        ) from error
    return MujocoPhysics(robot, *stations)
