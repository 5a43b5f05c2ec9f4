"""Descriptions of others: the same robot is read whatever its file calls joints and angles."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from glassgait.diagrams.description_reader import read_description
from glassgait.models.errors import InputError
from glassgait.models.robots.description import urdf
from glassgait.models.robots.library import load_robot, read_robot, robot_names
from glassgait.models.robots.proposal import propose, robot_text
from glassgait.models.robots.quadruped import JOINTS, LEG_JOINTS, LEGS

A1 = load_robot()

LENGTHS = ("hip_offset", "thigh_offset", "thigh_length", "calf_length", "foot_radius", "mass")
BOXES = ("trunk_box", "thigh_box", "calf_box")
TURN = st.floats(-0.6, 0.6)


def numbers(text):
    """Floats of a triple."""
    return [float(word) for word in text.split()]


def disguised(robot, *, signs, thigh_turn, calf_turn, order, shift=(0.0, 0.0, 0.0)):
    """Returns a robot's URDF with names, zero angles, axes and a trunk's frame of its own."""
    root = ElementTree.fromstring(robot.urdf_path.read_text())
    root.set("name", "other")
    turns = {"hip": 0.0, "thigh": thigh_turn, "calf": calf_turn}
    for joint in root.findall("joint"):
        kind = joint.get("name").partition("_")[2]
        sign, turn = signs[kind], turns[kind]
        axis, limit, origin = (joint.find(part) for part in ("axis", "limit", "origin"))
        axis.set("xyz", " ".join(str(sign * value) for value in numbers(axis.get("xyz"))))
        # Ours is sign · theirs + turn.
        ends = sorted(sign * (float(limit.get(end)) - turn) for end in ("lower", "upper"))
        limit.set("lower", str(ends[0]))
        limit.set("upper", str(ends[1]))
        origin.set("rpy", f"0 {turn} 0")
        if kind == "hip":
            place = np.add(numbers(origin.get("xyz")), shift)
            origin.set("xyz", " ".join(map(str, place)))
    trunk = root.find("link[@name='trunk']/inertial/origin")
    trunk.set("xyz", " ".join(map(str, np.add(numbers(trunk.get("xyz")), shift))))
    text = ElementTree.tostring(root, encoding="unicode")
    renamed = {leg: f"leg{order.index(leg)}" for leg in LEGS}
    for leg, name in renamed.items():
        text = text.replace(f'"{leg}_', f'"{name}_')
    return text.replace('"trunk"', '"base"')


@pytest.fixture
def described(tmp_path):
    """Returns a function that writes a description, and reads it."""

    def read(text, name="other.urdf"):
        path = tmp_path / name
        path.write_text(text)
        return read_description(path)

    return read


def entries_of(found, name="dog"):
    return {entry.key: entry for entry in propose(found, name)}


@pytest.mark.parametrize("name", robot_names())
def test_robots_that_ship_are_read_as_their_files_have_them(name):
    robot = load_robot(name)
    plain = yaml.safe_load(
        robot_text(found := read_description(robot.urdf_path), propose(found, "dog"))
    )
    for key in (*LENGTHS, *BOXES):
        np.testing.assert_allclose(plain[key], getattr(robot, key), rtol=1e-5)
    # A stance of others' proportions is that of these robots themselves.
    np.testing.assert_allclose(
        [plain["stance"][leg] for leg in LEGS], robot.default_stance.reshape(4, 3)
    )
    for leg, own in found.legs.items():
        index = JOINTS.index(f"{leg}_hip")
        np.testing.assert_allclose(own.limits[:, 0], robot.lower_limits[index : index + 3])
        np.testing.assert_allclose(own.effort, robot.effort[index : index + 3])
        np.testing.assert_allclose(own.velocity, robot.velocity[index : index + 3])
    for part in ("trunk", "hip", "thigh"):
        ours, theirs = robot.inertias[part], plain["inertias"][part]
        np.testing.assert_allclose(theirs["center"], ours.center, atol=1e-9)
        np.testing.assert_allclose(theirs["izz"], ours.izz, rtol=1e-5)


@given(
    signs=st.fixed_dictionaries({kind: st.sampled_from([-1.0, 1.0]) for kind in LEG_JOINTS}),
    thigh_turn=TURN,
    calf_turn=TURN,
    order=st.permutations(LEGS),
    shift=st.tuples(*[st.floats(-0.1, 0.1)] * 3),
)
@settings(max_examples=20, deadline=None)
def test_a_robot_in_disguise_is_the_same_robot(
    tmp_path_factory, signs, thigh_turn, calf_turn, order, shift
):
    path = tmp_path_factory.mktemp("robot") / "other.urdf"
    path.write_text(
        disguised(
            A1, signs=signs, thigh_turn=thigh_turn, calf_turn=calf_turn, order=order, shift=shift
        )
    )
    found = read_description(path)
    for leg, own in found.legs.items():
        assert own.joints[0] == f"leg{order.index(leg)}_hip"
        np.testing.assert_array_equal(own.sign, [signs[kind] for kind in LEG_JOINTS])
        np.testing.assert_allclose(own.offset, [0.0, thigh_turn, calf_turn], atol=1e-9)
    plain = yaml.safe_load(robot_text(found, propose(found, "dog")))
    own = yaml.safe_load(robot_text(known := read_description(A1.urdf_path), propose(known, "dog")))
    for key in ("full_name", "trunk_box", "thigh_box", "calf_box", "motor_order"):
        del plain[key], own[key]
    assert plain.keys() == own.keys()
    np.testing.assert_allclose(leaves(plain), leaves(own), rtol=1e-4, atol=1e-6)


def leaves(value):
    """All numbers of nested dictionaries and lists, in order."""
    if isinstance(value, dict):
        return [leaf for key in sorted(value) for leaf in leaves(value[key])]
    if isinstance(value, list):
        return [leaf for part in value for leaf in leaves(part)]
    return [value] if isinstance(value, (int, float)) else []


@pytest.mark.parametrize("name", robot_names())
def test_what_is_written_loads_as_a_robot(name, tmp_path):
    found = read_description(load_robot(name).urdf_path)
    path = tmp_path / "robot.yaml"
    path.write_text(robot_text(found, propose(found, "dog")))
    read = read_robot(path)
    read.urdf_path.write_text(urdf(read))
    robot = load_robot(path)
    assert robot.mass == pytest.approx(found.mass)
    assert {entry.source for entry in propose(found, "dog")} == {"found", "proposed"}


def test_what_a_description_does_not_say_is_left_open(described, tmp_path):
    text = re.sub(r"<limit [^>]*/>", "", A1.urdf_path.read_text()).replace("revolute", "continuous")
    found = described(text)
    missing = [key for key, entry in entries_of(found).items() if entry.source == "missing"]
    assert missing == ["position_limits", "effort_limits", "velocity_limits"]
    path = tmp_path / "robot.yaml"
    path.write_text(robot_text(found, propose(found, "dog")))
    with pytest.raises(InputError, match="position_limits"):
        read_robot(path)


def test_a_foot_without_a_sphere_is_where_its_link_is(described):
    root = ElementTree.fromstring(A1.urdf_path.read_text())
    for link in root.findall("link"):
        for shape in [
            own for own in link.findall("collision") if own.find("geometry/sphere") is not None
        ]:
            link.remove(shape)
    bare = ElementTree.tostring(root, encoding="unicode")
    with pytest.raises(InputError, match="FL_calf has neither a sphere"):
        described(bare)
    for leg in LEGS:
        ElementTree.SubElement(root, "link", name=f"{leg}_toe")
        joint = ElementTree.SubElement(root, "joint", name=f"{leg}_end", type="fixed")
        ElementTree.SubElement(joint, "parent", link=f"{leg}_calf")
        ElementTree.SubElement(joint, "child", link=f"{leg}_toe")
        ElementTree.SubElement(joint, "origin", xyz=f"0 0 {-A1.calf_length}")
    found = described(ElementTree.tostring(root, encoding="unicode"))
    assert found.legs["FL"].calf_length == pytest.approx(A1.calf_length)
    assert (found.legs["RR"].foot, found.legs["RR"].foot_body) == ("", "RR_toe")
    assert entries_of(found)["foot_radius"].source == "proposed"


def test_legs_that_weigh_otherwise_are_made_alike_and_keep_the_whole(described):
    text = A1.urdf_path.read_text().replace('<mass value="0.888"/>', '<mass value="1.2"/>', 1)
    found = described(text)
    assert found.mass == pytest.approx(A1.mass + 0.312)
    assert float(entries_of(found)["mass"].value) == pytest.approx(found.mass)


def broken(change):
    root = ElementTree.fromstring(A1.urdf_path.read_text())
    change(root)
    return ElementTree.tostring(root, encoding="unicode")


def weld(root, names):
    for joint in root.findall("joint"):
        if joint.get("name") in names:
            joint.set("type", "fixed")


def turn(root, name, axis):
    root.find(f"joint[@name='{name}']/axis").set("xyz", axis)


def move(root, name, xyz):
    root.find(f"joint[@name='{name}']/origin").set("xyz", xyz)


@pytest.mark.parametrize(
    ("change", "refused"),
    [
        (lambda root: weld(root, {"FL_calf", "FR_calf", "RL_calf", "RR_calf"}), "2, 2, 2, 2"),
        (lambda root: weld(root, {"FL_hip", "FL_thigh", "FL_calf"}), "3, 3, 3;"),
        (lambda root: turn(root, "RL_thigh", "0 0.8 0.6"), "joint RL_thigh turns about"),
        (lambda root: turn(root, "RL_thigh", "1 0 0"), "joint RL_thigh turns about"),
        (lambda root: move(root, "FL_thigh", "0 0.0838 0.02"), "beside"),
        (lambda root: move(root, "RR_calf", "0 0 -0.25"), "thigh's length of RR"),
        (lambda root: move(root, "RR_hip", "0.1805 0.047 0"), "two legs are FL"),
    ],
)
def test_what_is_no_such_quadruped_is_refused(described, change, refused):
    with pytest.raises(InputError, match=re.escape(refused)):
        described(broken(change))


@pytest.mark.parametrize(
    ("text", "name"),
    [("", "a.urdf"), ("<robot", "a.urdf"), ("<mujoco/>", "a.xml"), ("<robot name='a'/>", "a.urdf")],
)
def test_what_is_no_description_is_refused(described, text, name):
    with pytest.raises(InputError, match=re.escape(name)):
        described(text, name)


def test_other_formats_are_refused(tmp_path):
    (tmp_path / "a.sdf").write_text("<sdf/>")
    with pytest.raises(InputError, match="URDF or an MJCF"):
        read_description(tmp_path / "a.sdf")
    with pytest.raises(InputError, match="no such file"):
        read_description(tmp_path / "none.urdf")
