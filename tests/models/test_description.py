"""The robot's description: the file, its masses and its mirror images."""

import numpy as np
import pytest

from glassgait.models.robots import description
from glassgait.models.robots.robot import load_robot

A1 = load_robot()


def test_file_is_what_the_table_gives():
    assert A1.urdf_path.read_text() == description.urdf()


def test_total_mass():
    legs = [description.HIP, description.THIGH, description.CALF, description.FOOT]
    assert description.TRUNK.mass + 4 * sum(part.mass for part in legs) == pytest.approx(12.776)


def test_merging_keeps_mass_moment_and_inertia():
    calf, foot = description.CALF, description.FOOT
    body = description.merged(calf, foot)
    assert body.mass == pytest.approx(calf.mass + foot.mass)
    moment = calf.mass * np.array(calf.center) + foot.mass * np.array(foot.center)
    np.testing.assert_allclose(body.mass * np.array(body.center), moment)

    def about_origin(part):
        arm = np.array(part.center)
        return part.matrix() + part.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))

    np.testing.assert_allclose(about_origin(body), about_origin(calf) + about_origin(foot))


def test_mirroring_twice_is_nothing():
    part = description.THIGH
    assert part.mirrored(y=True) != part
    assert part.mirrored(y=True).mirrored(y=True) == part
    assert part.mirrored(x=True, y=True).ixy == part.ixy


@pytest.mark.parametrize("part", [description.TRUNK, description.HIP, description.THIGH])
def test_inertias_are_physical(part):
    moments = np.linalg.eigvalsh(part.matrix())
    assert moments[0] > 0
    assert moments[0] + moments[1] >= moments[2]
