"""The display of machine state and contacts."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.library import load_robot
from glassgait.systems.gait_display import GaitDisplay

A1 = load_robot()


class FakeMeshcat:
    """Keeps what it is asked to show; a real one sends that to a browser and forgets it."""

    def __init__(self):
        self.objects, self.places, self.visible, self.times = [], {}, {}, []

    def SetObject(self, path, shape, rgba):  # noqa: N802 - as Meshcat's
        self.objects.append(path)

    def SetTransform(self, path, pose, time):  # noqa: N802
        self.places[path] = pose.translation()
        self.times.append(time)

    def SetProperty(self, path, name, value, time):  # noqa: N802
        assert name == "visible"
        self.visible[path] = value


@pytest.fixture
def meshcat():
    return FakeMeshcat()


@pytest.fixture
def inputs(standing):
    standing[quadruped.POSITION] = [1.0, 2.0, 0.3]
    return {"state": standing, "rm_state": [0.0, 1.0], "foot_contact": [1.0, 0.0, 0.0, 1.0]}


def test_has_an_object_for_every_state_and_foot(trot, meshcat):
    GaitDisplay(A1, trot, meshcat)
    states = [f"gait/state/{i}" for i in range(trot.n_states)]
    assert meshcat.objects == states + [f"gait/contact/{leg}" for leg in quadruped.LEGS]


def show(system, context):
    Simulator(system, context).Initialize()


def test_shows_the_machines_state_and_the_feet_that_touch(trot, meshcat, inputs, fix_inputs):
    system = GaitDisplay(A1, trot, meshcat)
    show(system, fix_inputs(system, **inputs))
    shown = {path for path, visible in meshcat.visible.items() if visible}
    assert shown == {"gait/state/1", "gait/contact/FL", "gait/contact/RR"}
    assert set(meshcat.visible) == set(meshcat.objects)


def test_contacts_are_marked_where_the_feet_are(trot, meshcat, inputs, fix_inputs):
    system = GaitDisplay(A1, trot, meshcat)
    turned = kinematics.standing_state(A1)
    turned[quadruped.QUATERNION] = [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]
    show(system, fix_inputs(system, **{**inputs, "state": turned}))
    x, y, _ = kinematics.foot_positions(A1, A1.default_stance)[quadruped.LEGS.index("RL")]
    place = meshcat.places["gait/contact/RL"]
    np.testing.assert_allclose(place[:2], [-y, x], atol=1e-12)
    assert place[2] == pytest.approx(kinematics.foot_heights(A1, turned)[2] + A1.foot_radius)
