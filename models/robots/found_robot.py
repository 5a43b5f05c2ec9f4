"""What the description of a quadruped says, in this project's terms."""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from glassgait.models.arrays import Array
from glassgait.models.robots.inertial import Inertial


class FoundLeg(NamedTuple):
    """A leg of a description, at angles 0 of ours.

    Attributes:
        joints: Names of its hip, thigh and calf joint in the file.
        bodies: Names of the bodies that these move.
        hip: Place of the hip joint from the middle of the four, at the thigh joint along x (3; m).
        outward: From the hip joint to the plane in which thigh and calf move, to the left (m).
        thigh_length: From the thigh joint to the knee (m).
        calf_length: From the knee to the foot's centre (m).
        foot_body: Name of the body at whose origin the foot is, where it has no sphere.
        foot: Name of the foot's sphere, as `parse_description` names it; empty without one.
        foot_radius: Its radius (m); None without one.
        sign: Our angle is sign · theirs + offset, of each joint (3).
        offset: The same (3; rad).
        limits: Least and greatest angles of ours (3, 2; rad); NaN where the file has none.
        effort: Greatest torques (3; N·m); NaN where the file has none.
        velocity: Greatest velocities (3; rad/s); NaN where the file has none.
        inertias: Of hip, thigh and calf with all that is welded to them, in our axes.
    """

    joints: tuple[str, ...]
    bodies: tuple[str, ...]
    hip: Array
    outward: float
    thigh_length: float
    calf_length: float
    foot_body: str
    foot: str
    foot_radius: float | None
    sign: Array
    offset: Array
    limits: Array
    effort: Array
    velocity: Array
    inertias: tuple[Inertial, ...]


@dataclass(frozen=True)
class FoundRobot:
    """What a description says of a quadruped.

    Attributes:
        path: The description.
        name: Its name there.
        trunk: Name of its trunk's body.
        middle: Middle of its hip joints in that body's frame (3; m); our trunk's frame is there.
        mass: Mass of the robot (kg).
        trunk_inertia: Of the trunk with all that is welded to it.
        trunk_box: Sizes of the greatest box of its collision shapes (m); None without one.
        limb_boxes: The same of front left thigh and calf, of which the first is along the limb.
        legs: The legs by name, in our order.
        order: Their names in the file's order.
    """

    path: Path
    name: str
    trunk: str
    middle: Array
    mass: float
    trunk_inertia: Inertial
    trunk_box: tuple[float, ...] | None
    limb_boxes: tuple[tuple[float, ...] | None, ...]
    legs: dict[str, FoundLeg]
    order: tuple[str, ...]
