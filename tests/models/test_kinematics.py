"""Closed-form kinematics, compared with Drake's."""

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder

from glassgait.diagrams.station import AddStation, StationConfig
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.library import load_robot

A1 = load_robot()
TOLERANCE = 1e-12


@pytest.fixture(scope="module")
def drake_plant():
    builder = DiagramBuilder()
    plant, _, _ = AddStation(builder, A1, StationConfig())
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    return plant, plant.GetMyMutableContextFromRoot(context), diagram, context


def box_points(box, middle):
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1)
    return 0.5 * np.array(box)[:, None] * signs + np.array([0, 0, middle])[:, None]


def test_points_heights_and_velocities_agree_with_drake_at_random_poses(drake_plant, random_states):
    plant, context, *_ = drake_plant
    world, trunk = plant.world_frame(), plant.GetFrameByName("trunk")
    for state in random_states(50):
        plant.SetPositionsAndVelocities(context, state)

        def locate(frame, point, expressed, context=context):
            moved = plant.GetFrameByName(frame)
            return plant.CalcPointsPositions(context, moved, point, expressed)

        feet = [locate(f"{leg}_calf", [0, 0, -0.2], trunk)[:, 0] for leg in quadruped.LEGS]
        found = kinematics.foot_positions(A1, state[quadruped.JOINT_POSITION])
        np.testing.assert_allclose(found, feet, atol=TOLERANCE)

        feet = [locate(f"{leg}_calf", [0, 0, -0.2], world)[:, 0] for leg in quadruped.LEGS]
        np.testing.assert_allclose(kinematics.world_feet(A1, state), feet, atol=TOLERANCE)
        low = [foot[2] - 0.02 for foot in feet]
        np.testing.assert_allclose(kinematics.foot_heights(A1, state), low, atol=TOLERANCE)

        def lower(frame, ends, locate=locate):
            points = locate(frame, np.array([[0, 0, end] for end in ends]).T, world)
            return points[:, np.argmin(points[2])]

        corners = locate("trunk", box_points(A1.trunk_box, 0.0), world)
        expected = [
            corners[:, np.argmin(corners[2])],
            *(lower(f"{leg}_thigh", [0.0, -0.2]) for leg in quadruped.LEGS),
            *(lower(f"{leg}_calf", [0.0, -0.18]) for leg in quadruped.LEGS),
        ]
        found = kinematics.lowest_body_points(A1, state, 0.9)
        np.testing.assert_allclose(found, expected, atol=TOLERANCE)

        limb_box = {"thigh": A1.thigh_box[::-1], "calf": A1.calf_box[::-1]}
        lowest = [locate("trunk", box_points(A1.trunk_box, 0.0), world)[2].min()]
        for limb, (x, y, z) in limb_box.items():
            for leg in quadruped.LEGS:
                lowest.append(locate(f"{leg}_{limb}", box_points((x, y, z), -0.1), world)[2].min())
        found = kinematics.clearances(A1, state)
        np.testing.assert_allclose(found.body, lowest, atol=TOLERANCE)
        np.testing.assert_array_equal(found.feet, kinematics.foot_heights(A1, state))
        upright = -kinematics.gravity_direction(state[quadruped.QUATERNION])[2]
        np.testing.assert_array_equal(found.upright, upright)

        velocity = trunk.CalcSpatialVelocity(context, world, trunk)
        linear, angular = kinematics.base_velocity(state)
        np.testing.assert_allclose(linear, velocity.translational(), atol=TOLERANCE)
        np.testing.assert_allclose(angular, velocity.rotational(), atol=TOLERANCE)

        motion = kinematics.foot_motion(
            A1, state[quadruped.JOINT_POSITION], state[quadruped.JOINT_VELOCITY]
        )
        for leg, own in zip(quadruped.LEGS, motion.turning, strict=True):
            shank = plant.GetFrameByName(f"{leg}_calf")
            turning = shank.CalcSpatialVelocity(context, trunk, trunk).rotational()
            np.testing.assert_allclose(own, turning, atol=TOLERANCE)


def test_foot_velocities_are_the_differences_of_positions(random_states, generator):
    pose = random_states(30)[:, quadruped.JOINT_POSITION]
    rates, step = generator.normal(size=pose.shape), 1e-6
    ahead, behind = (
        kinematics.foot_positions(A1, pose + sign * step * rates) for sign in (1.0, -1.0)
    )
    found = kinematics.foot_motion(A1, pose, rates).velocity
    np.testing.assert_allclose(found, (ahead - behind) / (2 * step), atol=1e-9)
