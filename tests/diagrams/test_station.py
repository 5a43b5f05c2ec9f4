"""The station: the robot as Drake sees it."""

import numpy as np
import pytest
from pydrake.geometry import Role
from pydrake.systems.framework import DiagramBuilder

from diagrams.station import AddA1Station, MakeA1Station, StationConfig, set_friction
from models.a1 import robot
from models.errors import InputError


@pytest.fixture(scope="module")
def station():
    builder = DiagramBuilder()
    plant, scene_graph, instance = AddA1Station(builder, StationConfig(friction=0.7))
    return plant, scene_graph, instance, builder.Build()


def test_mass_joints_and_limits(station):
    plant, _, instance, _ = station
    assert plant.CalcTotalMass(plant.CreateDefaultContext()) == pytest.approx(robot.MASS)
    names = plant.GetPositionNames(instance, add_model_instance_prefix=False)
    assert names[7:] == [f"{joint}_q" for joint in robot.JOINTS]
    np.testing.assert_allclose(plant.GetPositionLowerLimits()[7:], robot.LOWER_LIMITS)
    np.testing.assert_allclose(plant.GetPositionUpperLimits()[7:], robot.UPPER_LIMITS)


def test_every_joint_has_its_pd_controller_and_effort_limit(station):
    plant, *_ = station
    for name in robot.JOINTS:
        actuator = plant.GetJointActuatorByName(name)
        gains = actuator.get_controller_gains()
        assert (gains.p, gains.d) == (robot.STIFFNESS, robot.DAMPING)
        assert actuator.effort_limit() == robot.EFFORT_LIMIT


def test_friction_is_set_for_every_geometry_and_per_context(station):
    plant, scene_graph, _, diagram = station

    def frictions(inspector):
        return {
            inspector.GetProximityProperties(geometry)
            .GetProperty("material", "coulomb_friction")
            .static_friction()
            for geometry in inspector.GetAllGeometryIds(Role.kProximity)
        }

    assert frictions(scene_graph.model_inspector()) == {0.7}
    context = scene_graph.GetMyContextFromRoot(diagram.CreateDefaultContext())
    set_friction(plant, scene_graph, 0.4, context)
    query = scene_graph.get_query_output_port().Eval(context)
    assert frictions(query.inspector()) == {0.4}
    assert frictions(scene_graph.model_inspector()) == {0.7}


def test_robot_does_not_collide_with_itself(station):
    plant, scene_graph, instance, _ = station
    inspector = scene_graph.model_inspector()
    own = [
        geometry
        for body in plant.GetBodyIndices(instance)
        for geometry in plant.GetCollisionGeometriesForBody(plant.get_body(body))
    ]
    assert len(own) == 13
    assert not any(inspector.CollisionFiltered(a, b) is False for a in own for b in own if a != b)


def test_payload_weighs_on_the_trunk():
    builder = DiagramBuilder()
    plant, *_ = AddA1Station(builder, StationConfig(payload=2.0))
    assert plant.CalcTotalMass(plant.CreateDefaultContext()) == pytest.approx(14.776)


def test_station_exports_its_ports():
    station = MakeA1Station()
    assert station.GetInputPort("desired_state").size() == 24
    assert station.GetOutputPort("state").size() == 37
    assert station.HasOutputPort("contact_results")


@pytest.mark.parametrize("field", ["time_step", "friction", "payload", "relaxation_time"])
def test_negative_settings_are_refused(field):
    with pytest.raises(InputError, match=f"{field} is -1"):
        StationConfig(**{field: -1.0})
