"""Foot contacts from poses."""

import numpy as np
from pydrake.systems.framework import DiagramBuilder

from glassgait.diagrams.station import AddStation, StationConfig
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.robot import load_robot
from glassgait.models.task.contact import sense_feet

A1 = load_robot()


NONE = np.zeros(4, dtype=bool)


def test_pressed_feet_touch_and_lifted_feet_do_not(standing):
    pressed = standing.copy()
    pressed[6] -= 0.012
    assert sense_feet(A1, pressed, NONE).touching.all()
    lifted = standing.copy()
    lifted[6] += 0.001
    assert not sense_feet(A1, lifted, NONE).touching.any()


def test_contact_outlasts_the_touch_by_one_step(standing):
    lifted = standing.copy()
    lifted[6] += 0.01
    before = np.array([True, False, True, False])
    sense = sense_feet(A1, lifted, before)
    np.testing.assert_array_equal(sense.contact, before)
    assert not sense.touching.any()
    assert not sense_feet(A1, lifted, sense.touching).contact.any()


def test_touching_is_what_drakes_contact_solver_finds(generator):
    builder = DiagramBuilder()
    plant, _, _ = AddStation(builder, A1, StationConfig())
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    instance = plant.GetModelInstanceByName("a1")
    plant.get_desired_state_input_port(instance).FixValue(plant_context, np.zeros(24))
    for _ in range(20):
        joints = A1.default_stance + 0.1 * generator.normal(size=12)
        state = kinematics.standing_state(A1, joints)
        state[6] -= generator.uniform(0, 0.03)
        plant.SetPositionsAndVelocities(plant_context, state)
        results = plant.get_contact_results_output_port().Eval(plant_context)
        bodies = set()
        for i in range(results.num_point_pair_contacts()):
            info = results.point_pair_contact_info(i)
            bodies |= {plant.get_body(b).name() for b in (info.bodyA_index(), info.bodyB_index())}
        pressing = [f"{leg}_calf" in bodies for leg in quadruped.LEGS]
        np.testing.assert_array_equal(sense_feet(A1, state, NONE).touching, pressing)
