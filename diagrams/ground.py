"""The ground under the robot: its friction, and how it gives way."""

from collections.abc import Callable
from typing import Any

from pydrake.geometry import GeometryId, ProximityProperties, Role, RoleAssign, SceneGraph
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.systems.framework import Context


def set_friction(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    friction: float,
    context: Context | None = None,
) -> None:
    """Sets the friction of every contact between robot and ground.

    Args:
        plant: The station's plant.
        scene_graph: The station's scene graph.
        friction: Coulomb friction, static and dynamic.
        context: The scene graph's context to change; without one, the model's default changes.
    """
    _set_material(
        plant,
        scene_graph,
        "coulomb_friction",
        lambda _: CoulombFriction(friction, friction),
        () if context is None else (context,),
    )


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
