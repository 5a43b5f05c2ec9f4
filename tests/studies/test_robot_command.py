"""`glassgait robot`: files are checked, and the robot must stand in both physics."""

import json
import re

import numpy as np
import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from glassgait.diagrams.mujoco_physics import make_model
from glassgait.diagrams.station import AddStation, StationConfig
from glassgait.models.robots import kinematics
from glassgait.models.robots.library import load_robot, robot_names
from glassgait.models.robots.quadruped import JOINTS, LEG_JOINTS, LEGS
from glassgait.studies.cli import main

A1 = load_robot()


@pytest.mark.parametrize("name", robot_names())
def test_robots_that_ship_stand_in_both_physics(name, capsys):
    main(["robot", name])
    shown = capsys.readouterr().out
    assert re.search(r"drake .* 4 ", shown) and re.search(r"mujoco .* 4 ", shown)


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        (r"stiffness: .*", "stiffness: 4", "raise the stiffness"),
        (r"R([LR]): \[[^\]]*\]", r"R\1: [0.1, 1.9, -1.0]", "leans"),
    ],
)
def test_a_robot_that_does_not_stand_is_refused(write_robot, refused, old, new, why):
    dog = write_robot()
    dog.write_text(re.sub(old, new, dog.read_text()))
    assert why in refused(["robot", str(dog)])


WELDED = """
  <link name="payload"><collision><geometry><box size="0.2 0.15 0.1"/></geometry></collision></link>
  <joint name="1" type="fixed"><parent link="trunk"/><child link="payload"/></joint>
  <link name="toe"><inertial><mass value="0.02"/></inertial></link>
  <joint name="2" type="fixed">
    <origin xyz="0 0 -0.2"/><parent link="FL_calf"/><child link="toe"/>
  </joint>
  <link name="mast"><inertial>
    <origin xyz="0.1 0 0.2" rpy="0.3 0 1"/>
    <mass value="0.5"/><inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0.001" ixz="0" iyz="0"/>
  </inertial></link>
  <joint name="3" type="fixed">
    <origin xyz="0 0.1 0.2" rpy="0.4 1 2"/><parent link="mast"/><child link="trunk"/>
  </joint>
</robot>"""
"""A box without mass, a point mass, and a link that carries the trunk."""


def test_welded_links_weigh_in_both_simulators_what_drake_reads_in_the_file(write_robot):
    dog = write_robot()
    text = A1.urdf_path.read_text().replace('joint name="', 'joint name="j_')
    text = re.sub("<visual>.*</visual>", "", text).replace("</robot>", WELDED)
    (dog.parent / "a1.urdf").write_text(text)
    names = {leg: [f"j_{leg}_{kind}" for kind in LEG_JOINTS] for leg in LEGS}
    dog.write_text(f"joints: {json.dumps(names)}\n{dog.read_text()}")
    robot = load_robot(dog)
    assert robot.mass == pytest.approx(A1.mass + 0.52, rel=1e-12)
    own, _, instance = AddStation(DiagramBuilder(), robot, StationConfig())
    model = make_model(robot, StationConfig(time_step=0.002, engine="mujoco"))
    # What Drake reads, without our rewriting.
    plant = MultibodyPlant(0.01)
    Parser(plant).AddModelsFromString(text, "urdf")
    plant.Finalize()
    total = 0.0
    for link in ("trunk", *JOINTS):
        body = plant.GetBodyByName(link)
        welded = [each.index() for each in plant.GetBodiesWeldedTo(body)]
        context = plant.CreateDefaultContext()
        expected = numbers_of(plant.CalcSpatialInertia(context, body.body_frame(), welded))
        found = numbers_of(own.GetBodyByName(link, instance).default_spatial_inertia())
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)
        # MuJoCo stores principal moments and their axes.
        theirs = model.body(link)
        axes = kinematics.rotation_matrix(theirs.iquat)
        moments = axes @ np.diag(theirs.inertia) @ axes.T
        mujoco = np.concatenate([theirs.mass, theirs.ipos, moments.ravel()])
        np.testing.assert_allclose(mujoco, found, rtol=1e-6, atol=1e-8)
        total += found[0]
    assert total == pytest.approx(robot.mass, rel=1e-9)


def numbers_of(inertia):
    """Returns mass, centre and inertia about the centre of Drake's spatial inertia."""
    centre = inertia.get_com()
    moments = inertia.Shift(centre).CalcRotationalInertia().CopyToFullMatrix3()
    return np.concatenate([[inertia.get_mass()], centre, moments.ravel()])
