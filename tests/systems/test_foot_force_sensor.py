"""Forces at the feet: they carry the robot, each foot's by itself."""

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.multibody.plant import ContactResults

from glassgait.diagrams.rollout import make_simulator
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.unitree_robot import MakeUnitreeRobot, at_its_rate
from glassgait.models.robots.library import load_robot
from glassgait.systems.foot_force_sensor import FootForceSensor

A1 = load_robot()


@pytest.fixture(scope="module")
def stood():
    """A robot that has come to rest at its stance, and its context."""
    diagram = MakeUnitreeRobot(at_its_rate(Scenario(sensor_noise=0.0)))
    simulator = make_simulator(diagram)
    context = simulator.get_mutable_context()
    stance = np.concatenate([A1.default_stance, np.zeros(12)])
    diagram.GetInputPort("desired_state").FixValue(context, stance)
    diagram.GetInputPort("actuation").FixValue(context, np.zeros(12))
    simulator.AdvanceTo(1.0)
    return diagram, context


def test_forces_carry_a_robot_at_rest(stood):
    diagram, context = stood
    force = diagram.GetOutputPort("foot_force").Eval(context)
    assert np.all(force > 10.0)
    assert force.sum() == pytest.approx(9.81 * A1.mass, rel=0.02)


def test_the_imu_measures_gravity_over_two_milliseconds(stood):
    diagram, context = stood
    imu = diagram.GetOutputPort("imu").Eval(context)
    np.testing.assert_allclose(np.linalg.norm(imu[3:6]), 0.002 * 9.81, rtol=0.02)


def test_no_contact_is_no_force():
    system = FootForceSensor({})
    context = system.CreateDefaultContext()
    port = system.get_contact_results_input_port()
    port.FixValue(context, AbstractValue.Make(ContactResults()))
    np.testing.assert_array_equal(system.get_foot_force_output_port().Eval(context), np.zeros(4))
