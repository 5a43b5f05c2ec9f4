"""The ground under the robot: its geometry, its friction, and how it gives way."""

from collections.abc import Callable
from typing import Any

from pydrake.geometry import (
    Box,
    GeometryId,
    HalfSpace,
    ProximityProperties,
    Role,
    RoleAssign,
    SceneGraph,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.systems.framework import Context

from glassgait.models.task.terrain import PLANE, REACH, Terrain, grid_of

PATCH = "patch"
"""Name of the boxes of the ground that have the patches' friction, before their number."""


LAID, MOST_LAID = 2.5, 12
"""How far around the middle period a diagram's ground is laid, in m and in cells: boxes take time
to add, the more the more there are."""


def laid(terrain: Terrain) -> float:
    """Returns how far around the middle period a diagram's ground is laid (m)."""
    return max(REACH, min(LAID, MOST_LAID * float(grid_of(terrain).cell.min())))


def add_ground(plant: MultibodyPlant, terrain: Terrain, reach: float = REACH) -> None:
    """Adds the ground: a half space, or the boxes of a tile.

    Args:
        plant: The station's plant, not finalized yet.
        terrain: The ground.
        reach: How far around the middle period boxes are laid (m).
    """
    world, friction = plant.world_body(), CoulombFriction(1.0, 1.0)
    if terrain.is_plane:
        plant.RegisterCollisionGeometry(world, RigidTransform(), HalfSpace(), "ground", friction)
        return
    for i, box in enumerate(terrain.boxes(reach)):
        pose = RigidTransform(RotationMatrix(box.rotation), box.centre)
        name = f"{PATCH if box.is_patch else 'ground'}_{i}"
        plant.RegisterCollisionGeometry(world, pose, Box(*box.size), name, friction)


def set_friction(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    friction: float,
    context: Context | None = None,
    *,
    terrain: Terrain = PLANE,
) -> None:
    """Sets the friction of every contact between robot and ground.

    Args:
        plant: The station's plant.
        scene_graph: The station's scene graph.
        friction: Coulomb friction, static and dynamic.
        context: The scene graph's context to change; without one, the model's default changes.
        terrain: The ground, whose patches keep a friction of their own.
    """
    ground = set(plant.GetCollisionGeometriesForBody(plant.world_body()))
    inspector = scene_graph.model_inspector()
    feet = 2.0 * max(friction, terrain.patch_friction) if terrain.patches else friction

    def of(geometry: GeometryId) -> CoulombFriction:
        if not terrain.patches or geometry not in ground:
            return CoulombFriction(feet, feet)
        is_patch = inspector.GetName(geometry).startswith(PATCH)
        wanted = terrain.patch_friction if is_patch else friction
        # Two bodies have twice the product of their frictions over the sum.
        own = wanted * feet / (2.0 * feet - wanted) if wanted else 0.0
        return CoulombFriction(own, own)

    where = () if context is None else (context,)
    _set_material(plant, scene_graph, "coulomb_friction", of, where)


def set_ground(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    *,
    relaxation_time: float,
    stiffness: float | None,
    dissipation: float | None,
) -> None:
    """Sets how soft every contact between robot and ground is.

    Args:
        plant: The station's plant.
        scene_graph: The station's scene graph.
        relaxation_time: Time in which a contact lets penetration relax (s).
        stiffness: Stiffness of a contact (N/m); Drake's own by default.
        dissipation: Hunt and Crossley's dissipation of a contact (s/m); Drake's own by default.
    """
    # The two bodies of a contact add their relaxation times up, and a body without one counts as
    # 0.1 s.
    ground = set(plant.GetCollisionGeometriesForBody(plant.world_body()))
    _set_material(
        plant,
        scene_graph,
        "relaxation_time",
        lambda geometry: 0.0 if geometry in ground else relaxation_time,
    )
    if stiffness is not None:
        # Like two springs in a row.
        _set_material(plant, scene_graph, "point_contact_stiffness", lambda _: 2.0 * stiffness)
    if dissipation is not None:
        _set_material(plant, scene_graph, "hunt_crossley_dissipation", lambda _: dissipation)


def _set_material(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    name: str,
    value: Callable[[GeometryId], Any],
    where: tuple[Context, ...] = (),
) -> None:
    inspector = scene_graph.model_inspector()
    for geometry in inspector.GetAllGeometryIds(Role.kProximity):
        properties = ProximityProperties(inspector.GetProximityProperties(geometry))
        properties.UpdateProperty("material", name, value(geometry))
        scene_graph.AssignRole(
            *where, plant.get_source_id(), geometry, properties, RoleAssign.kReplace
        )
