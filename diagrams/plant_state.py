"""The robot in its diagram: where it is, and how it is placed and pushed."""

from collections.abc import Iterator

from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, Diagram

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.robots import kinematics, quadruped
from glassgait.systems.fall_monitor import FallMonitor

FALL_MONITOR = "fall_monitor"


def find_locomotion(diagram: Diagram) -> Diagram:
    """Finds what `MakeLocomotion` built: the diagram itself, or a part of it at any depth.

    Raises:
        InputError: if there is none, or more than one.
    """
    found = list(_locomotions(diagram))
    if len(found) != 1:
        raise InputError(
            f"locomotion: diagram {diagram.get_name()!r} holds {len(found)} of what MakeLocomotion "
            "builds; give one that holds exactly one"
        )
    return found[0]


def set_plant_state(diagram: Diagram, context: Context, state: Array | None = None) -> None:
    """Puts the robot into a state.

    Args:
        diagram: What `MakeLocomotion` built, or a larger diagram that holds it.
        context: Its own context, or the root context that its context is part of; to be changed.
        state: The plant's state x (37); standing at rest by default.

    Raises:
        InputError: if the context is of another diagram.
    """
    plant, plant_context = _find_plant(diagram, context)
    if state is None:
        monitor = find_locomotion(diagram).GetSubsystemByName(FALL_MONITOR)
        assert isinstance(monitor, FallMonitor)
        state = kinematics.standing_state(monitor.robot)
    plant.SetPositionsAndVelocities(plant_context, state)


def push(diagram: Diagram, context: Context, velocity: Array) -> None:
    """Adds to the velocity of the robot's trunk.

    Args:
        diagram: What `MakeLocomotion` built, or a larger diagram that holds it.
        context: Its own context, or the root context that its context is part of; to be changed.
        velocity: What is added (3; m/s, world frame).

    Raises:
        InputError: if the context is of another diagram.
    """
    plant, plant_context = _find_plant(diagram, context)
    state = plant.GetPositionsAndVelocities(plant_context)
    state[quadruped.LINEAR_VELOCITY] += velocity
    plant.SetPositionsAndVelocities(plant_context, state)


def _find_plant(diagram: Diagram, context: Context) -> tuple[MultibodyPlant, Context]:
    """Finds the robot's plant and its part of the diagram's own context, or of the root's."""
    plant = find_locomotion(diagram).GetSubsystemByName("plant")
    assert isinstance(plant, MultibodyPlant)
    try:
        diagram.ValidateContext(context)
        return plant, diagram.GetMutableSubsystemContext(plant, context)
    except RuntimeError:
        pass
    try:
        return plant, plant.GetMyMutableContextFromRoot(context)
    except RuntimeError as error:
        raise InputError(
            f"locomotion: the context is not of diagram {diagram.get_name()!r}; give its own "
            "context, or the root's"
        ) from error


def _locomotions(diagram: Diagram) -> Iterator[Diagram]:
    # A larger diagram may give it another name; its fall monitor is always there.
    if diagram.HasSubsystemNamed(FALL_MONITOR) and isinstance(
        diagram.GetSubsystemByName(FALL_MONITOR), FallMonitor
    ):
        yield diagram
    for system in diagram.GetSystems():
        if isinstance(system, Diagram):
            yield from _locomotions(system)
