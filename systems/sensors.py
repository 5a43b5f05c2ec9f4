"""The robot's sensors with their errors, and the true values that only a simulation knows."""

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
from glassgait.models.task.observation import JOINT_NOISE, N_ESTIMATED
from glassgait.models.task.randomization import Randomization, seed_of
from glassgait.systems.base import STATE, FunctionSystem, MealySystem, Outputs

SOUND_SENSORS = stuck_sensors((), ())  # contact sensors (4)


class JointSensor(FunctionSystem):
    """Measures positions and velocities of the joints.

    .. pydrake_system::

        name: JointSensor
        input_ports: [state, uniform_noise, encoder_bias]
        output_ports: [joints]

    Inputs: state (37), the plant's. uniform_noise (24, in [0, 1]), on positions, then velocities,
    and encoder_bias (12, rad), added to positions; either may stay unconnected.
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
        # Only positions have a bias: an encoder that is off by an angle still sees all its changes.
        bias = np.zeros(quadruped.N_JOINTS) + encoder_bias
        error = noise + np.concatenate([bias, np.zeros(quadruped.N_JOINTS)])
        joints = [state[quadruped.JOINT_POSITION], state[quadruped.JOINT_VELOCITY]]
        return {"joints": np.concatenate(joints) + error}


class FootSensor(MealySystem):
    """Senses which feet touch the ground and how high they are.

    .. pydrake_system::

        name: FootSensor
        input_ports: [state]
        output_ports: [foot_contact, foot_height, touching]

    Inputs: state (37), the plant's.
    Outputs: foot_contact (4, {0, 1}), FL FR RL RR, now or at the previous control step.
    foot_height (4, m), of each foot's lowest point above the ground. touching (4, {0, 1}), which
    feet press on the ground at this instant.
    State: contacts of the previous control step.
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
    """Reads contacts, flips some at random, and always reads the same where it is stuck.

    .. pydrake_system::

        name: ContactSensor
        input_ports: [touching, uniform_noise]
        output_ports: [sensed_contact]

    Inputs: touching (4, {0, 1}), FL FR RL RR. uniform_noise (4, in [0, 1]); may stay unconnected,
    and then no reading is flipped.
    Outputs: sensed_contact (4, {0, 1}), the opposite where the noise is below `flip_share`, and the
    same at all times where `stuck` (4; see `stuck_sensors`) says so.
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
        wrong = np.zeros(quadruped.N_LEGS, dtype=bool)
        if uniform_noise is not None:
            wrong = uniform_noise < self._flip_share
        read = read_contacts(touching > 0.5, wrong, self._stuck)
        return {"sensed_contact": read.astype(float)}


class ImuSensor(MealySystem):
    """Measures angular velocity, change of velocity and gravity's direction.

    Drake's `Gyroscope` measures the first as well; its `Accelerometer` measures an instant, while
    `glassgait.models.estimation.sensors` needs the sum over a control period.

    .. pydrake_system::

        name: ImuSensor
        input_ports: [state, uniform_noise, imu_bias]
        output_ports: [imu]

    Inputs: state (37), the plant's. uniform_noise (9, in [0, 1]) and imu_bias (9), added to a
    reading; either may stay unconnected.
    Outputs: imu (9; rad/s, m/s, none), a reading by `glassgait.models.estimation.sensors`, of this
    control instant or as many before as it is late; at first the first.
    State: whether there is an instant before (1), the trunk's velocity then (3, world frame), and
    the readings that are still to come (delay × 9). Drake's `DiscreteTimeDelay` would latch after
    the velocity had been overwritten.
    """

    def __init__(self, gravity: Array, delay: int = 0, noise_factor: float = 1.0) -> None:
        """Takes gravity's acceleration (3; m/s², world frame), and a delay in control steps."""
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
        # This instant's reading.
        has_begun = memory[0] > 0.5
        velocity = state[quadruped.LINEAR_VELOCITY]
        reading = measure_imu(state, memory[1:4] if has_begun else velocity, self._gravity)
        if uniform_noise is not None:
            reading = reading + self._half_width * (2.0 * uniform_noise - 1.0)
        if imu_bias is not None:
            reading = reading + imu_bias
        # Behind it those that are still to come, the latest first.
        coming = memory[4:].reshape(-1, N_IMU)
        readings = np.vstack([reading, coming if has_begun else np.tile(reading, (len(coming), 1))])
        after = np.concatenate([[1.0], velocity, readings[:-1].ravel()])
        return {"imu": readings[-1]}, after


class SensorBias(FunctionSystem):
    """Draws the errors that a robot's sensors have for a whole episode.

    .. pydrake_system::

        name: SensorBias
        input_ports: [seed]
        output_ports: [encoder_bias, imu_bias]

    Inputs: seed (1), any number.
    Outputs: encoder_bias (12, rad), of measured joint positions. imu_bias (9), of the IMU's
    readings, in their order and units.
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
    """Gives the true body state, which an estimator would estimate.

    .. pydrake_system::

        name: BodyStateSensor
        input_ports: [state]
        output_ports: [body_state]

    Inputs: state (37), the plant's.
    Outputs: body_state (7), base linear velocity scaled by 2 (m/s, trunk frame) and foot heights
    (m) above the ground.
    """

    def __init__(self, robot: Robot, ground: Ground = LEVEL_GROUND) -> None:
        super().__init__(inputs={"state": STATE}, outputs={"body_state": N_ESTIMATED})
        self._robot, self._ground = robot, ground

    def evaluate(self, state: Array) -> Outputs:
        return {"body_state": body_state(self._robot, state, self._ground)}


class WorldState(LeafSystem):
    """Gives the robot's state where it has gone to, on ground that repeats.

    .. pydrake_system::

        name: WorldState
        input_ports: [plant_state]
        output_ports: [state]

    Inputs: plant_state (37), with the trunk on the tile that is laid.
    Outputs: state (37), the same with the trunk where it has gone to.
    State: how far the trunk has been moved back in all (3, m), changed only from outside, by
    `glassgait.diagrams.rollout.recenter`.
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
        """Returns how far the trunk has been moved back (3; m)."""
        return np.array(context.get_discrete_state(self._away).value())

    def set_away(self, context: Context, away: Array) -> None:
        """Sets how far the trunk has been moved back (3; m), in a context to be changed."""
        context.SetDiscreteState(self._away, away)

    def _calc_state(self, context: Context, output: BasicVector) -> None:
        state = np.array(self._plant_state_port.Eval(context))
        state[quadruped.POSITION] += context.get_discrete_state(self._away).value()
        output.SetFromVector(state)
