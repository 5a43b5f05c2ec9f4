"""The task of the batch simulator, and the state of every robot in it."""

from dataclasses import field
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from annotated_types import Ge
from numpy.typing import NDArray

from glassgait.diagrams.commands import DrawnCommands, FixedCommand, SliderCommand
from glassgait.diagrams.scenario import Scenario
from glassgait.models.arrays import Array, map_arrays
from glassgait.models.control import BoolArray, Memory, Sensors
from glassgait.models.errors import InputError
from glassgait.models.policies.controller import Controller, expert_of
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import DEFAULT_LAW, JointLaw, Robot
from glassgait.models.settings import Settings, checked
from glassgait.models.task import EPISODE_STEPS
from glassgait.models.task.command import Command
from glassgait.models.task.gait import Gait
from glassgait.models.task.randomization import Randomization
from glassgait.models.task.reward import RewardWeights
from glassgait.models.task.termination import TerminationLimits

NO_SLIDERS = "command is of sliders, which only a robot in Meshcat has; give a speed"


@checked
class TaskConfig(Settings):
    """The task that the batch simulator plays."""

    title: ClassVar[str] = "task"

    gait: Gait
    randomization: Randomization = field(default_factory=Randomization)
    weights: RewardWeights = field(default_factory=RewardWeights)
    limits: TerminationLimits = field(default_factory=TerminationLimits)
    episode_steps: Annotated[int, Ge(1)] = EPISODE_STEPS  # control steps
    command: FixedCommand | DrawnCommands = field(default_factory=DrawnCommands)
    joint_law: JointLaw = DEFAULT_LAW
    robot: Robot = field(default_factory=load_robot)
    observes_imu: bool = False  # gravity's direction and the angular velocity

    @classmethod
    def of_scenario(
        cls,
        gait: Gait,
        scenario: Scenario,
        policy: Controller | Policy | None = None,
        *,
        episode_steps: int = EPISODE_STEPS,
    ) -> "TaskConfig":
        """Returns the task of a gait in a scenario, with a policy's joints and observation."""
        # Refuse what cannot be played.
        command = scenario.command
        if isinstance(command, SliderCommand):
            raise InputError(f"{scenario.refused_as()}: {NO_SLIDERS}")
        command.check(gait)
        if policy is not None:
            policy.refuse_other_machine(gait)
        return cls(
            gait,
            scenario.randomization(),
            weights=scenario.weights,
            limits=scenario.limits,
            episode_steps=episode_steps,
            command=command,
            joint_law=scenario.joint_law(policy),
            robot=scenario.robot_of(policy),
            observes_imu=policy is not None and expert_of(policy).layout.imu,
        )


class TaskState(NamedTuple):
    """State of each robot between two control steps; a value."""

    # Arrays are never written to: a change gives another state.
    plant: Array  # states x (n, 37)
    command: Command  # velocities (n, 2; m/s, rad/s), dwells (n,; control steps)
    memory: Memory  # of the controllers, with the last step's action
    touching: BoolArray  # feet (n, 4)
    air_time: Array  # of each foot (n, 4; s)
    tracked: Array  # speeds compared with the command (n, 2; m/s, rad/s)
    action_before: Array  # actions of the step before the last (n, 12)
    joint_noise: Array  # on positions, then velocities (n, 24; rad, rad/s)
    bias: Array  # of joint positions, then of the IMU (n, 21; rad, its units)
    imu: Array  # readings, the latest first, one more than it is late (n, k, 9)
    stuck: NDArray[np.int8]  # contact sensors (n, 4), by `stuck_sensors`
    latency: Array  # until an action reaches the joints (n,; s)
    steps: NDArray[np.int64]  # since the episode's start (n,)

    def as_arrays(self) -> dict[str, NDArray]:
        """Returns every array by name, robots along the first axis."""
        return dict(_named(self))

    def with_arrays(self, arrays: dict[str, NDArray]) -> "TaskState":
        """Returns the state that `as_arrays` took apart."""
        names = iter(self.as_arrays())
        return map_arrays(lambda _: arrays[next(names)], self)

    def of_robots(self, index: NDArray[np.int64]) -> "TaskState":
        """Returns the state of the robots at `index`."""
        return map_arrays(lambda values: values[index], self)

    def with_robots(self, index: NDArray[np.int64], others: "TaskState") -> "TaskState":
        """Returns a state whose robots at `index` are those of `others`, in their order."""
        return map_arrays(lambda values, new: put(values, index, new), self, others)

    def sensors(self, touching: BoolArray | None = None) -> Sensors:
        """Returns the controllers' sensor readings, by default with the last contacts (n, 4)."""
        read = self.memory.trust.reading == 1 if touching is None else touching
        return measured(self.plant, self.joint_noise, read, self.imu)

    def pushed(self, velocity: Array) -> "TaskState":
        """Returns a state with a velocity (n, 3; m/s, world frame) added to each trunk's."""
        plant = self.plant.copy()
        plant[:, quadruped.LINEAR_VELOCITY] += velocity
        return self._replace(plant=plant)


def measured(plant: Array, joint_noise: Array, touching: BoolArray, imu: Array) -> Sensors:
    """Returns the readings of sensors; see `TaskState` for the arrays."""
    position, velocity = np.split(joint_noise, 2, axis=1)
    return Sensors(
        plant[:, quadruped.JOINT_POSITION] + position,
        plant[:, quadruped.JOINT_VELOCITY] + velocity,
        touching,
        imu[:, -1],
    )


def put(values: NDArray, index: NDArray[np.int64], new: NDArray) -> NDArray:
    """Returns an array with new values at `index`."""
    changed = values.copy()
    changed[index] = new
    return changed


def _named(value: Any, name: str = "") -> list[tuple[str, NDArray]]:
    """Lists the arrays of nested named tuples by their joined names, such as `command_dwell`."""
    if not isinstance(value, tuple):
        return [(name, value)]
    prefix = f"{name}_" if name else ""
    parts = value._asdict().items()  # type: ignore[attr-defined]
    return [found for key, part in parts for found in _named(part, prefix + key)]
