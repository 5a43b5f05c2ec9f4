"""The robot's sensors with their errors, and true values from the simulation."""

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from glassgait.models.arrays import Array
from glassgait.models.estimation.sensors import (
    IMU_NOISE,
    N_IMU,
    measure_imu,
    read_contacts,
    stuck_sensors,
)
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task.ground import LEVEL_GROUND, Ground, body_state, sense_feet
from glassgait.models.task.observation import JOINT_NOISE, N_ESTIMATED, are_sound
from glassgait.models.task.randomization import Randomization, seed_of
from glassgait.systems.base import STATE, FunctionSystem, MealySystem, Outputs

SOUND_SENSORS = stuck_sensors((), ())  # contact sensors (4)
NO_IMU = np.zeros(N_IMU)


class JointSensor(FunctionSystem):
    """Measures joint positions and velocities.

    .. pydrake_system::

        name: JointSensor
        input_ports: [state, uniform_noise, encoder_bias]
        output_ports: [joints]

    Inputs: state (37), the plant's. uniform_noise (24, in [0, 1]), of positions, then velocities,
    and encoder_bias (12, rad), added to the positions; either may stay unconnected.
    Outputs: joints (24; rad, rad/s), measured positions, then velocities.
    """

    def __init__(self, noise_factor: float = 1.0) -> None:
        super().__init__(
            inputs={"state": STATE, "uniform_noise": 24, "encoder_bias": 12},
            outputs={"joints": 2 * quadruped.N_JOINTS},
            optional=("uniform_noise", "encoder_bias"),
        )
        self._half_width = noise_factor * JOINT_NOISE

    def evaluate(
        self, state: Array, uniform_noise: Array | float = 0.5, encoder_bias: Array | float = 0.0
    ) -> Outputs:
        noise = self._half_width * (2.0 * uniform_noise - 1.0)
        # An encoder's constant offset does not affect the measured velocity.
        bias = np.zeros(quadruped.N_JOINTS) + encoder_bias
        error = noise + np.concatenate([bias, np.zeros(quadruped.N_JOINTS)])
        joints = [state[quadruped.JOINT_POSITION], state[quadruped.JOINT_VELOCITY]]
        return {"joints": np.concatenate(joints) + error}


class FootSensor(MealySystem):
    """Measures the feet's contacts and heights.

    .. pydrake_system::

        name: FootSensor
        input_ports: [state]
        output_ports: [foot_contact, foot_height, touching]

    Inputs: state (37), the plant's.
    Outputs: foot_contact (4, {0, 1}), FL FR RL RR, contact now or at the previous control step.
    foot_height (4, m), of each foot's lowest point above the ground. touching (4, {0, 1}), contact
    now.
    State: contacts of the previous control step (4).
    """

    def __init__(self, robot: Robot, ground: Ground = LEVEL_GROUND) -> None:
        n = quadruped.N_LEGS
        super().__init__(
            inputs={"state": STATE},
            outputs={"foot_contact": n, "foot_height": n, "touching": n},
            memory=np.zeros(n),
        )
        self._robot, self._ground = robot, ground

    def step(self, memory: Array, state: Array) -> tuple[Outputs, Array]:
        sense = sense_feet(self._robot, state, memory > 0.5, ground=self._ground)
        contact, touching = sense.contact.astype(float), sense.touching.astype(float)
        outputs = {"foot_contact": contact, "foot_height": sense.height, "touching": touching}
        return outputs, touching


class ContactSensor(FunctionSystem):
    """Measures contacts with sensors that flip at random or are stuck.

    .. pydrake_system::

        name: ContactSensor
        input_ports: [touching, uniform_noise]
        output_ports: [sensed_contact]

    Inputs: touching (4, {0, 1}), FL FR RL RR. uniform_noise (4, in [0, 1]); if it is unconnected,
    no reading flips.
    Outputs: sensed_contact (4, {0, 1}), flipped if the noise is below `flip_share`, constant for
    sensors that are stuck (`stuck`, 4; see `stuck_sensors`).
    """

    def __init__(self, flip_share: float, stuck: NDArray[np.int8] = SOUND_SENSORS) -> None:
        n = quadruped.N_LEGS
        super().__init__(
            inputs={"touching": n, "uniform_noise": n},
            outputs={"sensed_contact": n},
            optional=("uniform_noise",),
        )
        self._flip_share, self._stuck = flip_share, stuck

    def evaluate(self, touching: Array, uniform_noise: Array | None = None) -> Outputs:
        flipped = np.zeros(quadruped.N_LEGS, dtype=bool)
        if uniform_noise is not None:
            flipped = uniform_noise < self._flip_share
        sensed = read_contacts(touching > 0.5, flipped, self._stuck)
        return {"sensed_contact": sensed.astype(float)}


class ImuSensor(MealySystem):
    """Measures angular velocity, change of velocity and the direction of gravity.

    Drake's `Gyroscope` also measures angular velocity. Its `Accelerometer` measures an instant,
    while `glassgait.models.estimation.sensors` needs the sum over a control period.

    .. pydrake_system::

        name: ImuSensor
        input_ports: [state, uniform_noise, imu_bias]
        output_ports: [imu]

    Inputs: state (37), the plant's. uniform_noise (9, in [0, 1]) and imu_bias (9), added to the
    reading; either may stay unconnected.
    Outputs: imu (9; rad/s, m/s, dimensionless), the reading of `delay` control steps ago, or the
    first one until then; see `glassgait.models.estimation.sensors`.
    State: whether there was a previous instant (1), the trunk's velocity then (3; m/s, world
    frame), and the delayed readings (delay × 9). Drake's `DiscreteTimeDelay` would latch too late,
    after the velocity is overwritten.
    """

    def __init__(self, gravity: Array, delay: int = 0, noise_factor: float = 1.0) -> None:
        """Sets the acceleration of gravity (3; m/s², world frame) and the delay (control steps)."""
        super().__init__(
            inputs={"state": STATE, "uniform_noise": N_IMU, "imu_bias": N_IMU},
            outputs={"imu": N_IMU},
            memory=np.zeros(4 + delay * N_IMU),
            optional=("uniform_noise", "imu_bias"),
        )
        self._gravity = np.array(gravity, dtype=float)
        self._half_width = noise_factor * IMU_NOISE

    def step(
        self,
        memory: Array,
        state: Array,
        uniform_noise: Array | None = None,
        imu_bias: Array | None = None,
    ) -> tuple[Outputs, Array]:
        has_begun = memory[0] > 0.5
        velocity = state[quadruped.LINEAR_VELOCITY]
        reading = measure_imu(state, memory[1:4] if has_begun else velocity, self._gravity)
        if uniform_noise is not None:
            reading = reading + self._half_width * (2.0 * uniform_noise - 1.0)
        if imu_bias is not None:
            reading = reading + imu_bias
        # Append the delayed readings, the latest first.
        delayed = memory[4:].reshape(-1, N_IMU)
        delayed = delayed if has_begun else np.tile(reading, (len(delayed), 1))
        readings = np.vstack([reading, delayed])
        after = np.concatenate([[1.0], velocity, readings[:-1].ravel()])
        return {"imu": readings[-1]}, after


class ReadingCheck(FunctionSystem):
    """Passes readings on while all are sound; see `are_sound`.

    .. pydrake_system::

        name: ReadingCheck
        input_ports: [joints, touching, imu]
        output_ports: [sound_joints, sound_touching, sound_imu]

    Inputs: joints (24; rad, rad/s), touching (4, {0, 1}), and imu (9), which may stay unconnected.
    Outputs: the same, or NaN in all of them.
    """

    def __init__(self) -> None:
        sizes = {"joints": 2 * quadruped.N_JOINTS, "touching": quadruped.N_LEGS, "imu": N_IMU}
        outputs = {f"sound_{name}": size for name, size in sizes.items()}
        super().__init__(inputs=sizes, outputs=outputs, optional=("imu",))

    def evaluate(self, joints: Array, touching: Array, imu: Array = NO_IMU) -> Outputs:
        factor = 1.0 if are_sound(joints, imu) else np.nan
        readings = {"joints": joints, "touching": touching, "imu": imu}
        return {f"sound_{name}": factor * reading for name, reading in readings.items()}


class SensorBias(FunctionSystem):
    """Draws constant sensor errors for an episode.

    .. pydrake_system::

        name: SensorBias
        input_ports: [seed]
        output_ports: [encoder_bias, imu_bias]

    Inputs: seed (1), any number.
    Outputs: encoder_bias (12, rad), of the measured joint positions. imu_bias (9), of the IMU's
    readings, in the same order and units.
    """

    def __init__(self, randomization: Randomization) -> None:
        super().__init__(
            inputs={"seed": 1}, outputs={"encoder_bias": quadruped.N_JOINTS, "imu_bias": N_IMU}
        )
        self._randomization = randomization

    def evaluate(self, seed: Array) -> Outputs:
        generator = np.random.default_rng(seed_of(seed))
        biases = self._randomization.biases(1, generator)[0]
        joints, imu = np.split(biases, [quadruped.N_JOINTS])
        return {"encoder_bias": joints, "imu_bias": imu}


class BodyStateSensor(FunctionSystem):
    """Outputs the true body state in place of an estimate.

    .. pydrake_system::

        name: BodyStateSensor
        input_ports: [state]
        output_ports: [body_state]

    Inputs: state (37), the plant's.
    Outputs: body_state (7), base linear velocity times 2 (m/s, trunk frame) and foot heights above
    the ground (m).
    """

    def __init__(self, robot: Robot, ground: Ground = LEVEL_GROUND) -> None:
        super().__init__(inputs={"state": STATE}, outputs={"body_state": N_ESTIMATED})
        self._robot, self._ground = robot, ground

    def evaluate(self, state: Array) -> Outputs:
        return {"body_state": body_state(self._robot, state, self._ground)}


class WorldState(LeafSystem):
    """Outputs the robot's unwrapped state on ground that repeats.

    .. pydrake_system::

        name: WorldState
        input_ports: [plant_state]
        output_ports: [state]

    Inputs: plant_state (37), with the trunk within the modelled period of the ground.
    Outputs: state (37), with the trunk's unwrapped position.
    State: the total displacement by which the trunk was moved back (3, m). Only
    `glassgait.diagrams.rollout.recenter` changes it.
    """

    def __init__(self) -> None:
        super().__init__()
        self._away = self.DeclareDiscreteState(3)
        self._plant_state_port = self.DeclareVectorInputPort("plant_state", STATE)
        self.DeclareVectorOutputPort(
            name="state",
            size=STATE,
            calc=self._calc_state,
            prerequisites_of_calc={self.all_input_ports_ticket(), self.xd_ticket()},
        )

    def away(self, context: Context) -> Array:
        """Returns the displacement by which the trunk was moved back (3; m)."""
        return np.array(context.get_discrete_state(self._away).value())

    def set_away(self, context: Context, away: Array) -> None:
        """Sets the displacement by which the trunk was moved back (3; m)."""
        context.SetDiscreteState(self._away, away)

    def _calc_state(self, context: Context, output: BasicVector) -> None:
        state = np.array(self._plant_state_port.Eval(context))
        state[quadruped.POSITION] += context.get_discrete_state(self._away).value()
        output.SetFromVector(state)
