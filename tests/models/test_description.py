"""The robots' descriptions: the files, their masses and their mirror images."""

import numpy as np
import pytest

from glassgait.models.robots.description import merged, mirrored, urdf
from glassgait.models.robots.library import load_robot, robot_names

A1 = load_robot()


@pytest.mark.parametrize("name", robot_names())
def test_file_is_what_the_inertias_give(name):
    robot = load_robot(name)
    assert robot.urdf_path.read_text() == urdf(robot)


def test_merging_keeps_mass_moment_and_inertia():
    calf, foot = A1.inertias["calf"], A1.inertias["foot"]
    body = merged(calf, foot)
    assert body.mass == pytest.approx(calf.mass + foot.mass)
    moment = calf.mass * np.array(calf.center) + foot.mass * np.array(foot.center)
    np.testing.assert_allclose(body.mass * np.array(body.center), moment)

    def about_origin(part):
        arm = np.array(part.center)
        return part.matrix + part.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))

    np.testing.assert_allclose(about_origin(body), about_origin(calf) + about_origin(foot))


def test_mirroring_twice_is_nothing():
    part = A1.inertias["thigh"]
    assert mirrored(part, y=True) != part
    assert mirrored(mirrored(part, y=True), y=True) == part
    assert mirrored(part, x=True, y=True).ixy == part.ixy
