"""Foot contacts from poses, and stuck contact sensors."""

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder

from glassgait.diagrams.station import AddStation, StationConfig
from glassgait.models.estimation.sensors import (
    LOW,
    UNCHANGED_STEPS,
    ContactTrust,
    believed_contacts,
)
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.ground import sense_feet

A1 = load_robot()
NONE = np.zeros(4, dtype=bool)


def test_contact_outlasts_the_touch_by_one_step(standing):
    standing[6] -= 0.012
    assert sense_feet(A1, standing, NONE).touching.all()
    lifted = standing.copy()
    lifted[6] += 0.013
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


HIGH = np.array([0.05, LOW / 2, 0.05, -0.01])
"""Heights of feet (m): one in the air and one on the ground, in front and behind."""


def believe(trust, reading, height=HIGH):
    """Returns the memory of the sensors and which feet touch now, from readings and heights."""
    contacts = believed_contacts(trust, reading, lambda: height)
    return contacts.trust, contacts.touching


def test_a_sensor_is_believed_as_long_as_it_changes():
    trust = ContactTrust.begin()
    for step in range(4 * UNCHANGED_STEPS):
        reading = np.full(4, step // (UNCHANGED_STEPS // 2) % 2 == 0)
        trust, touching = believe(trust, reading)
        np.testing.assert_array_equal(touching, reading)


@pytest.mark.parametrize("stuck", [False, True])
def test_the_height_of_a_foot_says_more_than_a_sensor_that_is_stuck(stuck):
    trust, reading = ContactTrust.begin(), np.full(4, stuck)
    for step in range(UNCHANGED_STEPS + 3):
        trust, touching = believe(trust, reading)
        np.testing.assert_array_equal(touching, reading if step < UNCHANGED_STEPS else HIGH < LOW)
    # A sensor that changes again is no longer stuck; the others are.
    _, touching = believe(trust, reading ^ np.array([True, False, False, False]))
    np.testing.assert_array_equal(touching, [not stuck, *(HIGH < LOW)[1:]])


def test_robots_are_trusted_one_by_one():
    reading = np.array([[True] * 4, [False] * 4])
    trust, _ = believe(ContactTrust.begin((2,)), reading)
    for _ in range(UNCHANGED_STEPS):
        reading = reading ^ np.array([[True], [False]])
        trust, touching = believe(trust, reading, np.tile(HIGH, (2, 1)))
    np.testing.assert_array_equal(touching, [reading[0], HIGH < LOW])
