"""The station: the robot as Drake sees it."""

import numpy as np
import pytest
from pydrake.geometry import Role
from pydrake.systems.framework import DiagramBuilder

from glassgait.diagrams.station import AddStation, StationConfig, set_friction
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot

A1 = load_robot()


@pytest.fixture(scope="module")
def station():
    builder = DiagramBuilder()
    plant, scene_graph, instance = AddStation(builder, A1, StationConfig(friction=0.7))
    return plant, scene_graph, instance, builder.Build()


def test_mass_joints_and_limits(station):
    plant, _, instance, _ = station
    assert plant.CalcTotalMass(plant.CreateDefaultContext()) == pytest.approx(A1.mass)
    names = plant.GetPositionNames(instance, add_model_instance_prefix=False)
    assert names[7:] == [f"{joint}_q" for joint in quadruped.JOINTS]
    np.testing.assert_allclose(plant.GetPositionLowerLimits()[7:], A1.lower_limits)
    np.testing.assert_allclose(plant.GetPositionUpperLimits()[7:], A1.upper_limits)


def test_every_joint_has_its_pd_controller_and_effort_limit(station):
    plant, *_ = station
    for name in quadruped.JOINTS:
        actuator = plant.GetJointActuatorByName(name)
        gains = actuator.get_controller_gains()
        assert (gains.p, gains.d) == (A1.stiffness, A1.damping)
        assert actuator.effort_limit() == A1.effort[0]


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


def make_station(config=None):
    builder = DiagramBuilder()
    plant, _, instance = AddStation(builder, A1, config or StationConfig())
    builder.ExportInput(plant.get_desired_state_input_port(instance), "desired_state")
    builder.ExportOutput(plant.get_state_output_port(), "state")
    return builder.Build()


def test_the_robot_stands_in_a_default_context(standing):
    for config in (StationConfig(), StationConfig(time_step=0.002, payload=2.0)):
        station = make_station(config)
        state = station.GetOutputPort("state").Eval(station.CreateDefaultContext())
        np.testing.assert_allclose(state, standing, atol=1e-15)


@pytest.mark.parametrize("strength", [1.0, 0.8])
def test_the_plants_motors_give_no_more_than_their_effort(strength):
    builder = DiagramBuilder()
    plant, _, instance = AddStation(builder, A1, StationConfig(motor_strength=strength))
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    own = plant.GetMyMutableContextFromRoot(context)
    far = np.tile([30.0, -30.0], quadruped.N_JOINTS // 2)
    desired = np.concatenate([far, np.zeros(quadruped.N_JOINTS)])
    plant.get_desired_state_input_port(instance).FixValue(own, desired)
    torque = plant.get_net_actuation_output_port(instance).Eval(own)
    greatest = strength * A1.effort[0]
    np.testing.assert_allclose(torque, np.sign(far) * greatest, rtol=1e-9)
