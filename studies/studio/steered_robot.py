"""One robot that is advanced control step by control step, and sampled after each."""

from dataclasses import dataclass

import numpy as np

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import begin_anew, make_simulator, push, recenter
from glassgait.diagrams.scenario import Scenario
from glassgait.models.arrays import Array
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait
from glassgait.studies.common.play import pusher

SAMPLED = (
    "state",
    "rm_state",
    "foot_contact",
    "observations",
    "actions",
    "reward",
    "served_dwell",
    "failures",
)
"""Outputs of the diagram that are sampled."""


def initial_command(gait: Gait) -> FixedCommand:
    """Returns where sliders begin: straight on at half the greatest speed."""
    return FixedCommand(0.5 * gait.max_speed, 0.0, sum(gait.dwell) // 2)


@dataclass(frozen=True)
class Sample:
    """A robot at a control instant, before the instant's updates.

    Attributes:
        step: Control steps since the robot began.
        state: The plant's state x (37).
        rm_state: The machine's state (n_states, one-hot).
        foot_contact: Which feet touch (4).
        observation: What the policy observes (n).
        target: Joint targets that act from now on (12; rad).
        reward: Reward of the step that ends now.
        served_dwell: Commanded control steps that were served by changes of state in that step.
        fallen: Whether the robot has fallen.
    """

    step: int
    state: Array
    rm_state: Array
    foot_contact: Array
    observation: Array
    target: Array
    reward: float
    served_dwell: float
    fallen: bool

    @property
    def joints(self) -> Array:
        """Joint angles (12; rad)."""
        return self.state[quadruped.JOINT_POSITION]

    @property
    def speed(self) -> float:
        """Forward speed of the trunk, in its own frame (m/s)."""
        return float(kinematics.base_velocity(self.state)[0][0])


class SteeredRobot:
    """A robot in its diagram, standing at first."""

    def __init__(
        self, gait: Gait, scenario: Scenario, controller: AlternatingController, *, seed: int
    ) -> None:
        """
        Args:
            gait: The gait.
            scenario: The scenario, of a discrete plant.
            controller: The controller.
            seed: Seed of the sensors' noise and of pushes.

        Raises:
            InputError: if a policy does not fit the gait or the scenario.
        """
        self._robot = controller.robot
        self._diagram = MakeLocomotion(gait, scenario, policy=controller)
        self._scenario = scenario
        self._simulator = make_simulator(self._diagram, seed=seed)
        self._context = self._simulator.get_mutable_context()
        self._pushed = pusher(self._simulator, scenario, seed)
        self._repeats = not scenario.station.terrain.is_plane
        # Looked up once: pydrake's look-ups fail where another thread looks through all objects.
        self._outputs = {name: self._diagram.GetOutputPort(name) for name in SAMPLED}
        self._command = self._diagram.GetInputPort("command")
        self._dwell = self._diagram.GetInputPort("commanded_dwell")
        self._step = 0

    def begin_anew(self, seed: int) -> None:
        """Stands again as at first, with another seed of noise and pushes."""
        begin_anew(self._simulator, seed=seed)
        self._pushed = pusher(self._simulator, self._scenario, seed)
        self._step = 0

    def steer(self, command: FixedCommand) -> None:
        """Commands the robot from now on."""
        self._command.FixValue(self._context, [command.speed, command.yaw_rate])
        self._dwell.FixValue(self._context, [float(command.dwell)])

    def push(self, velocity: Array) -> None:
        """Adds to the velocity of the trunk (3; m/s, in the directions of the trunk's heading)."""
        state = self._eval("state")
        forward = kinematics.rotation_matrix(state[quadruped.QUATERNION])[:, 0]
        cosine, sine = forward[:2] / np.linalg.norm(forward[:2])
        turned = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        push(self._diagram, self._context, turned @ velocity)

    def advance(self) -> None:
        """Advances by a control step.

        Raises:
            InputError: if the policy's action is not finite.
        """
        self._pushed()
        self._step += 1
        if self._repeats:
            recenter(self._diagram, self._context)
        self._simulator.AdvanceTo(self._step * CONTROL_PERIOD)

    def sample(self) -> Sample:
        """Returns what the robot is and does at this instant.

        Raises:
            InputError: as `advance`.
        """
        return Sample(
            step=self._step,
            state=self._eval("state"),
            rm_state=self._eval("rm_state"),
            foot_contact=self._eval("foot_contact"),
            observation=self._eval("observations"),
            target=self._robot.joint_targets(self._eval("actions")),
            reward=float(self._eval("reward")[0]),
            served_dwell=float(self._eval("served_dwell")[0]),
            fallen=bool((self._eval("failures") > 0.5).any()),
        )

    def _eval(self, port: str) -> Array:
        return np.array(self._outputs[port].Eval(self._context))
