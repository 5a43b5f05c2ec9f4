"""The task of the batch simulator, and the state of its robots."""

from dataclasses import field
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from annotated_types import Ge
from numpy.typing import NDArray

from glassgait.diagrams.commands import DrawnCommands, FixedCommand, SliderCommand
from glassgait.diagrams.scenario import Scenario
from glassgait.models.arrays import Array, map_arrays
from glassgait.models.control import BoolArray, Memory, Sensors, sound_readings
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

NO_SLIDERS = "command uses sliders, which need a robot in Meshcat; give command.speed"


@checked
class TaskConfig(Settings):
    """The task of the batch simulator."""

    title: ClassVar[str] = "task"

    gait: Gait
    randomization: Randomization = field(default_factory=Randomization)
    weights: RewardWeights = field(default_factory=RewardWeights)
    limits: TerminationLimits = field(default_factory=TerminationLimits)
    episode_steps: Annotated[int, Ge(1)] = EPISODE_STEPS  # control steps
    command: FixedCommand | DrawnCommands = field(default_factory=DrawnCommands)
    joint_law: JointLaw = DEFAULT_LAW
    robot: Robot = field(default_factory=load_robot)
    observes_imu: bool = False  # observe gravity's direction and the angular velocity

    @classmethod
    def of_scenario(
        cls, gait: Gait, scenario: Scenario, policy: Controller | Policy | None = None
    ) -> "TaskConfig":
        """Returns the task of a gait in a scenario, with a policy's joint law and observation."""
        command = scenario.command
        if isinstance(command, SliderCommand):
            raise InputError(f"{scenario.error_name()}: {NO_SLIDERS}")
        command.check(gait)
        if policy is not None:
            policy.refuse_other_machine(gait)
        return cls(
            gait,
            scenario.randomization(),
            weights=scenario.weights,
            limits=scenario.limits,
            command=command,
            joint_law=scenario.joint_law(policy),
            robot=scenario.robot_of(policy),
            observes_imu=policy is not None and expert_of(policy).layout.imu,
        )


class TaskState(NamedTuple):
    """State of each robot between two control steps."""

    # Arrays are never modified in place.
    plant: Array  # states x (n, 37)
    command: Command  # velocities (n, 2; m/s, rad/s), dwells (n,; control steps)
    memory: Memory  # of the controllers, with the last step's action
    touching: BoolArray  # foot contacts (n, 4)
    air_time: Array  # of each foot (n, 4; s)
    tracked: Array  # speeds compared with the command (n, 2; m/s, rad/s)
    action_before: Array  # actions of the step before the last (n, 12)
    joint_noise: Array  # errors of positions, then velocities (n, 24; rad, rad/s)
    bias: Array  # of joint positions, then of IMU readings (n, 21; rad, the IMU's units)
    imu: Array  # current and delayed readings, the latest first (n, 1 + delay, 9)
    stuck: NDArray[np.int8]  # states of contact sensors (n, 4); see `stuck_sensors`
    latency: Array  # time until an action reaches the joints (n,; s)
    steps: NDArray[np.int64]  # control steps since the episode's start (n,)

    def as_arrays(self) -> dict[str, NDArray]:
        """Returns every array by name, robots along the first axis."""
        return dict(_named(self))

    def with_arrays(self, arrays: dict[str, NDArray]) -> "TaskState":
        """Returns the state from the result of `as_arrays`."""
        names = iter(self.as_arrays())
        return map_arrays(lambda _: arrays[next(names)], self)

    def of_robots(self, index: NDArray[np.int64]) -> "TaskState":
        """Returns the state of the robots at `index`."""
        return map_arrays(lambda values: values[index], self)

    def with_robots(self, index: NDArray[np.int64], others: "TaskState") -> "TaskState":
        """Returns a state with the robots at `index` replaced by `others`, in order."""
        return map_arrays(lambda values, new: replaced(values, index, new), self, others)

    def sensors(self, touching: BoolArray | None = None) -> Sensors:
        """Returns the sensor readings, by default with the last contact readings (n, 4)."""
        contacts = self.memory.trust.reading == 1 if touching is None else touching
        return read_sensors(self.plant, self.joint_noise, contacts, self.imu)

    def pushed(self, velocity: Array) -> "TaskState":
        """Adds a velocity (n, 3; m/s, world frame) to each trunk; returns the new state."""
        plant = self.plant.copy()
        plant[:, quadruped.LINEAR_VELOCITY] += velocity
        return self._replace(plant=plant)


def read_sensors(plant: Array, joint_noise: Array, touching: BoolArray, imu: Array) -> Sensors:
    """Returns the sound sensor readings; see `TaskState` for the arrays."""
    position, velocity = np.split(joint_noise, 2, axis=1)
    position = plant[:, quadruped.JOINT_POSITION] + position
    velocity = plant[:, quadruped.JOINT_VELOCITY] + velocity
    return sound_readings(Sensors(position, velocity, touching, imu[:, -1]))


def replaced(values: NDArray, index: NDArray[np.int64], new: NDArray) -> NDArray:
    """Returns a copy with new values at `index`."""
    changed = values.copy()
    changed[index] = new
    return changed


def _named(value: Any, name: str = "") -> list[tuple[str, NDArray]]:
    """Lists the arrays of nested named tuples by their joined names, such as `command_dwell`."""
    if not isinstance(value, tuple):
        return [(name, value)]
    prefix = f"{name}_" if name else ""
    items = value._asdict().items()  # type: ignore[attr-defined]
    return [pair for key, item in items for pair in _named(item, prefix + key)]
