"""What the batch simulator's task remembers of every robot."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.estimation.contact import ContactTrust
from glassgait.models.estimation.odometry import OdometryState
from glassgait.models.robots import quadruped
from glassgait.models.task.command import Command
from glassgait.models.task.reward_machine import MachineState

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class TaskState:
    """All that the task remembers of each robot between two control steps.

    It is a value: its arrays are never written to, and whatever changes gives another state.

    Attributes:
        plant: Plant states x (n, 37).
        command: Velocities (n, 2; m/s, rad/s) and dwells (n,; control steps).
        machine: The reward machines' states.
        touching: Whether each foot touches (n, 4).
        air_time: Time each foot has been in the air (n, 4; s).
        fall_speed: How fast each foot came down when it last was in the air (n, 4; m/s).
        tracked: Speeds that were compared with the command (n, 2; m/s, rad/s).
        action: Actions of the last step (n, 12).
        action_before: Actions of the step before that (n, 12).
        joint_noise: Errors of measured joint positions, then velocities (n, 24; rad, rad/s).
        bias: Constant errors of measured joint positions and of the IMU (n, 21; rad, then as in a
            reading).
        imu: Readings of the IMU, the latest first, as many as it is late and one (n, k, 9).
        stuck: Which contact sensors are stuck (n, 4), as `stuck_sensors` returns it.
        trust: Which contact sensors are believed.
        sensed: Which feet seem to press on the ground, as far as sensors are believed (n, 4).
        latency: Time from an observation until its action reaches the joints (n,; s).
        estimate: Body state that the estimator gave at the last observation (n, 7; m/s, m); zeros
            where there is none.
        steps: Control steps since the episode's start (n,).
    """

    plant: Array
    command: Command
    machine: MachineState
    touching: BoolArray
    air_time: Array
    fall_speed: Array
    tracked: Array
    action: Array
    action_before: Array
    joint_noise: Array
    bias: Array
    imu: Array
    stuck: NDArray[np.int8]
    trust: ContactTrust
    sensed: BoolArray
    latency: Array
    estimate: Array
    odometry: OdometryState
    steps: NDArray[np.int64]

    def as_arrays(self) -> dict[str, NDArray]:
        """Returns every array by name, robots along the first axis."""
        return {
            "plant": self.plant,
            "command_velocity": self.command.velocity,
            "command_dwell": self.command.dwell,
            "machine_state": self.machine.state,
            "machine_iterations": self.machine.iterations,
            "machine_age": self.machine.age,
            "touching": self.touching,
            "air_time": self.air_time,
            "fall_speed": self.fall_speed,
            "tracked": self.tracked,
            "action": self.action,
            "action_before": self.action_before,
            "joint_noise": self.joint_noise,
            "bias": self.bias,
            "imu": self.imu,
            "stuck": self.stuck,
            **{f"contact_{part}": own for part, own in self.trust._asdict().items()},
            "sensed": self.sensed,
            "latency": self.latency,
            "estimate": self.estimate,
            **{f"odometry_{part}": own for part, own in self.odometry._asdict().items()},
            "steps": self.steps,
        }

    @staticmethod
    def from_arrays(arrays: dict[str, NDArray]) -> "TaskState":
        """Rebuilds the state that `as_arrays` took apart."""
        return TaskState(
            plant=arrays["plant"],
            command=Command(arrays["command_velocity"], arrays["command_dwell"]),
            machine=MachineState(
                arrays["machine_state"], arrays["machine_iterations"], arrays["machine_age"]
            ),
            touching=arrays["touching"],
            air_time=arrays["air_time"],
            fall_speed=arrays["fall_speed"],
            tracked=arrays["tracked"],
            action=arrays["action"],
            action_before=arrays["action_before"],
            joint_noise=arrays["joint_noise"],
            bias=arrays["bias"],
            imu=arrays["imu"],
            stuck=arrays["stuck"],
            trust=ContactTrust(*(arrays[f"contact_{part}"] for part in ContactTrust._fields)),
            sensed=arrays["sensed"],
            latency=arrays["latency"],
            estimate=arrays["estimate"],
            odometry=OdometryState(*(arrays[f"odometry_{part}"] for part in OdometryState._fields)),
            steps=arrays["steps"],
        )

    def of_robots(self, index: NDArray[np.int64]) -> "TaskState":
        """Returns the state of the robots at `index` alone."""
        return TaskState.from_arrays(
            {name: values[index] for name, values in self.as_arrays().items()}
        )

    def with_robots(self, index: NDArray[np.int64], others: "TaskState") -> "TaskState":
        """Returns a state whose robots at `index` are those of `others`, in their order."""
        theirs = others.as_arrays()
        return TaskState.from_arrays(
            {name: _put(mine, index, theirs[name]) for name, mine in self.as_arrays().items()}
        )

    def measured_joints(self) -> tuple[Array, Array]:
        """Returns joint positions and velocities as sensors measure them (n, 12; rad, rad/s)."""
        position, velocity = np.split(self.joint_noise, 2, axis=1)
        return (
            self.plant[:, quadruped.JOINT_POSITION] + position,
            self.plant[:, quadruped.JOINT_VELOCITY] + velocity,
        )

    def pushed(self, velocity: Array) -> "TaskState":
        """Returns a state with a velocity (n, 3; m/s, world frame) added to each trunk's."""
        plant = self.plant.copy()
        plant[:, quadruped.LINEAR_VELOCITY] += velocity
        return replace(self, plant=plant)

    def with_commands(self, index: NDArray[np.int64], command: Command) -> "TaskState":
        """Returns a state whose robots at `index` have other commands."""
        fresh = [_put(mine, index, new) for mine, new in zip(self.command, command, strict=True)]
        return replace(self, command=Command(*fresh))


def _put(values: NDArray, index: NDArray[np.int64], new: NDArray) -> NDArray:
    changed = values.copy()
    changed[index] = new
    return changed
