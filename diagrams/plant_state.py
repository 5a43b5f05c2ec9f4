"""The robot in its diagram: where it is, and how it is placed and pushed."""

from collections.abc import Iterator

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, Diagram, System

from glassgait.diagrams.station import WORLD_STATE
from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.robots import kinematics, quadruped
from glassgait.systems.fall_monitor import FallMonitor
from glassgait.systems.world_state import WorldState

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
        state: The plant's state x (37), wherever in the world; standing at rest by default.

    Raises:
        InputError: if the context is of another diagram.
    """
    plant, plant_context = _find_plant(diagram, context)
    monitor = _find_monitor(diagram)
    if state is None:
        state = monitor.ground.stand(monitor.robot, kinematics.standing_state(monitor.robot))
    world = _find_world_state(diagram, context)
    if world is not None:
        away = monitor.ground.periods(state)
        world[0].set_away(world[1], away)
        state = kinematics.moved_by(state, -away)
    plant.SetPositionsAndVelocities(plant_context, state)


def recenter(diagram: Diagram, context: Context) -> None:
    """Moves a robot that has left the middle period of its ground back by whole periods.

    What the diagram's outputs show stays as it is. On a plane nothing happens.

    Args:
        diagram: What `MakeLocomotion` built, or a larger diagram that holds it.
        context: Its own context, or the root context that its context is part of; to be changed,
            at a control instant.

    Raises:
        InputError: if the context is of another diagram.
    """
    world = _find_world_state(diagram, context)
    if world is None:
        return
    system, own = world
    plant, plant_context = _find_plant(diagram, context)
    monitor = _find_monitor(diagram)
    state = plant.GetPositionsAndVelocities(plant_context)
    away = monitor.ground.periods(state)
    if np.isfinite(away).all() and away.any():
        plant.SetPositionsAndVelocities(plant_context, kinematics.moved_by(state, -away))
        system.set_away(own, system.away(own) + away)


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
    return plant, _own_context(diagram, context, plant)


def _find_monitor(diagram: Diagram) -> FallMonitor:
    """Finds what knows the robot and its ground."""
    monitor = find_locomotion(diagram).GetSubsystemByName(FALL_MONITOR)
    assert isinstance(monitor, FallMonitor)
    return monitor


def _find_world_state(diagram: Diagram, context: Context) -> tuple[WorldState, Context] | None:
    """Finds what knows how far the robot has been moved back, on ground that repeats."""
    locomotion = find_locomotion(diagram)
    if not locomotion.HasSubsystemNamed(WORLD_STATE):
        return None
    world = locomotion.GetSubsystemByName(WORLD_STATE)
    assert isinstance(world, WorldState)
    return world, _own_context(diagram, context, world)


def _own_context(diagram: Diagram, context: Context, system: System) -> Context:
    """Returns a system's part of the diagram's own context, or of the root's."""
    try:
        diagram.ValidateContext(context)
        return diagram.GetMutableSubsystemContext(system, context)
    except RuntimeError:
        pass
    try:
        return system.GetMyMutableContextFromRoot(context)
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
