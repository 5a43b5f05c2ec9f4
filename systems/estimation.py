"""Systems that estimate the body state by odometry or a network."""

from collections.abc import Callable

import numpy as np
from pydrake.systems.framework import BasicVector, Context

from glassgait.models import BASE_VELOCITY_SCALE
from glassgait.models.arrays import Array
from glassgait.models.estimation.odometry import Odometry, OdometryState
from glassgait.models.estimation.sensors import N_IMU
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task.observation import N_ESTIMATED
from glassgait.systems.base import MealySystem, Outputs

FOOT_HEIGHT = slice(-quadruped.N_LEGS, None)
"""Entries of the foot heights, in the body state and in an estimator's memory."""


class StateEstimator(MealySystem):
    """Estimates the body state from proprioception by a learned network.

    .. pydrake_system::

        name: StateEstimator
        input_ports: [proprioception]
        output_ports: [body_state, previous_foot_height]

    Inputs: proprioception (40 + n_states), in the order of `ObservationLayout`; without a sound
    reading it has NaN, and the state stays.
    Outputs: body_state (7), base linear velocity times 2 (m/s, trunk frame) and foot heights (m).
    previous_foot_height (4, m), the foot heights at the previous control instant, zero at first.
    The reward machine reads these, since the estimator observes the RM state: the current heights
    would close an algebraic loop.
    State: the body state (7).
    """

    def __init__(self, estimator: Callable[[Array], Array], n_proprioceptive: int) -> None:
        """Sets the function from proprioception (40 + n_states) to the body state (7)."""
        super().__init__(
            inputs={"proprioception": n_proprioceptive},
            outputs={"body_state": N_ESTIMATED},
            memory=np.zeros(N_ESTIMATED),
        )
        self._estimator = estimator
        declare_previous_foot_height(self)

    def step(self, memory: Array, proprioception: Array) -> tuple[Outputs, Array]:
        body_state = memory if np.isnan(proprioception).any() else self._estimator(proprioception)
        return {"body_state": body_state}, body_state


class OdometrySystem(MealySystem):
    """Estimates the body state from the IMU, the joints and the stance feet.

    .. pydrake_system::

        name: OdometrySystem
        input_ports: [joints, imu, touching]
        output_ports: [body_state, previous_foot_height, expected_foot_height]

    Inputs: joints (24; rad, rad/s), measured positions, then velocities; without a sound reading
    they are NaN, and the state stays. imu (9), the IMU's reading. touching (4, {0, 1}), FL FR RL
    RR, the believed contacts.
    Outputs: body_state (7), base linear velocity times 2 (m/s, trunk frame) and foot heights above
    the plane of the footholds (m). previous_foot_height (4, m), as in `StateEstimator`.
    expected_foot_height (4, m), estimated without the current contacts. Both are zero at first.
    State: whether there was a previous instant (1), the `OdometryState` then (3 m/s, 12 m, 4,
    3 rad/s), and the foot heights then (4, m). Feedthrough: all inputs to body_state, joints to
    expected_foot_height.
    """

    def __init__(self, robot: Robot, odometry: Odometry) -> None:
        super().__init__(
            inputs={"joints": 2 * quadruped.N_JOINTS, "imu": N_IMU, "touching": quadruped.N_LEGS},
            outputs={"body_state": N_ESTIMATED},
            memory=np.zeros(27),
        )
        self._robot, self._odometry = robot, odometry
        declare_previous_foot_height(self)
        # `ContactTrustSystem` reads this output, which therefore must not depend on contacts.
        self.DeclareVectorOutputPort(
            name="expected_foot_height",
            size=quadruped.N_LEGS,
            calc=self._calc_expected_foot_height,
            prerequisites_of_calc={self._ports["joints"].ticket(), self.xd_ticket()},
        )

    def step(
        self, memory: Array, joints: Array, imu: Array, touching: Array
    ) -> tuple[Outputs, Array]:
        if np.isnan(joints[0]):
            velocity = BASE_VELOCITY_SCALE * memory[1:4]
            return {"body_state": np.concatenate([velocity, memory[FOOT_HEIGHT]])}, memory
        # Assume at the first instant that the robot is at rest.
        position, velocity = np.split(joints, 2)
        before = _unpacked(memory)
        if before is None:
            now = self._odometry.begin(self._robot, position)
        else:
            now = self._odometry.advance(
                self._robot,
                before,
                joint_position=position,
                joint_velocity=velocity,
                imu=imu,
                touching=touching > 0.5,
            )

        body_state = self._odometry.body_state(self._robot, now, position)
        after = [[1.0], now.velocity, now.footholds.ravel(), now.touching, now.turning]
        return {"body_state": body_state}, np.concatenate([*after, body_state[FOOT_HEIGHT]])

    def _calc_expected_foot_height(self, context: Context, output: BasicVector) -> None:
        before = _unpacked(self.memory(context))
        heights = np.zeros(quadruped.N_LEGS)
        if before is not None:
            position = self._ports["joints"].Eval(context)[: quadruped.N_JOINTS]
            heights = self._odometry.expected_heights(self._robot, before, position)
        output.SetFromVector(heights)


def declare_previous_foot_height(system: MealySystem) -> None:
    """Declares an output of the foot heights, the last entries of an estimator's memory."""

    def calc(context: Context, output: BasicVector) -> None:
        output.SetFromVector(system.memory(context)[FOOT_HEIGHT])

    system.DeclareVectorOutputPort(
        name="previous_foot_height",
        size=quadruped.N_LEGS,
        calc=calc,
        prerequisites_of_calc={system.xd_ticket()},
    )


def _unpacked(memory: Array) -> OdometryState | None:
    """Returns odometry's state at the previous instant; None if there was none."""
    begun, velocity, footholds, touching, turning, _ = np.split(memory, [1, 4, 16, 20, 23])
    if begun[0] < 0.5:
        return None
    return OdometryState(velocity, footholds.reshape(-1, 3), touching > 0.5, turning)
