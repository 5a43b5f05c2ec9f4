"""Shows the reward machine's state and the feet's contacts in Meshcat."""

import numpy as np
from pydrake.geometry import Box, Meshcat, Rgba, Sphere
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, EventStatus, LeafSystem

from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task.drawing import state_colors
from glassgait.models.task.gait import Gait
from glassgait.systems.base import STATE

DISPLAY_PERIOD = 1.0 / 32.0  # time between two frames (s)

PATH = "gait"
WORLD_PATH = "/drake"  # Meshcat's root of everything that Drake draws

PAVEMENT_PATH = "pavement"
TILE = 0.5  # edge of the pavement's tiles (m)


class GaitDisplay(LeafSystem):
    """Draws a beacon in the RM state's colour above the trunk, and marks feet in contact.

    .. pydrake_system::

        name: GaitDisplay
        input_ports: [state, rm_state, foot_contact]

    Inputs: state (37), the plant's. rm_state (n_states, one-hot). foot_contact (4, {0, 1}).
    Publishes to Meshcat every 1/32 s and when forced. The whole scene is moved so that the robot
    stays in the middle; the pavement moves by whole tiles, so it seems endless.
    """

    def __init__(self, robot: Robot, gait: Gait, meshcat: Meshcat) -> None:
        super().__init__()
        self._robot, self._gait, self._meshcat = robot, gait, meshcat
        self._state_port = self.DeclareVectorInputPort("state", STATE)
        self._rm_state_port = self.DeclareVectorInputPort("rm_state", gait.n_states)
        self._foot_contact_port = self.DeclareVectorInputPort("foot_contact", quadruped.N_LEGS)
        # Paths use the state's number, since its name may contain a slash.
        for i, color in enumerate(state_colors(gait)):
            shades = (int(color[start : start + 2], 16) / 255 for start in (1, 3, 5))
            meshcat.SetObject(f"{PATH}/state/{i}", Box(0.12, 0.05, 0.02), Rgba(*shades, 1.0))
        for leg in quadruped.LEGS:
            mark = Sphere(1.2 * robot.foot_radius)
            meshcat.SetObject(f"{PATH}/contact/{leg}", mark, Rgba(0.9, 0.6, 0.0, 1.0))
        self.DeclarePeriodicPublishEvent(
            period_sec=DISPLAY_PERIOD, offset_sec=0.0, publish=self._publish
        )
        self.DeclareForcedPublishEvent(self._publish)

    def _publish(self, context: Context) -> EventStatus:
        time = context.get_time()
        state = self._state_port.Eval(context)
        rm_state = self._rm_state_port.Eval(context)
        contact = self._foot_contact_port.Eval(context)
        origin = state[quadruped.POSITION]
        rotation = kinematics.rotation_matrix(state[quadruped.QUATERNION])

        # Move the world under the robot, since the camera of a recording cannot follow the robot.
        self._meshcat.SetTransform(WORLD_PATH, RigidTransform([-origin[0], -origin[1], 0.0]), time)
        tiles = TILE * np.round(origin[:2] / TILE)
        self._meshcat.SetTransform(PAVEMENT_PATH, RigidTransform([*tiles, 0.0]), time)

        # Place the beacon, and show it in the RM state's colour.
        above = RigidTransform(origin + np.array([0.0, 0.0, 0.16]))
        self._meshcat.SetTransform(f"{PATH}/state", above, time)
        for i in range(self._gait.n_states):
            shown = bool(rm_state[i] > 0.5)
            self._meshcat.SetProperty(f"{PATH}/state/{i}", "visible", shown, time)

        # Mark the feet in contact.
        angles = state[quadruped.JOINT_POSITION]
        feet = origin + kinematics.foot_positions(self._robot, angles) @ rotation.T
        for leg, foot, touches in zip(quadruped.LEGS, feet, contact, strict=True):
            mark = f"{PATH}/contact/{leg}"
            self._meshcat.SetTransform(mark, RigidTransform(foot), time)
            self._meshcat.SetProperty(mark, "visible", bool(touches > 0.5), time)
        return EventStatus.Succeeded()
