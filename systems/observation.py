"""Systems that compute the observation: contacts, reward machine, proprioception."""

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.estimation.sensors import N_IMU, ContactTrust, believed_contacts
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import ObservationLayout, proprioception
from glassgait.models.task.reward_machine import MachineState, RewardMachine
from glassgait.systems.base import FunctionSystem, MealySystem, Outputs

N = quadruped.N_JOINTS


class ContactTrustSystem(MealySystem):
    """Determines which feet touch, even if a contact sensor is stuck; see `ContactTrust`.

    .. pydrake_system::

        name: ContactTrustSystem
        input_ports: [touching, foot_height]
        output_ports: [believed_contact, believed_touching]

    Inputs: touching (4, {0, 1}), FL FR RL RR, the sensors' current readings; without a sound
    reading they are NaN, as are the outputs then, and the state stays. foot_height (4, m),
    estimated without the current contacts.
    Outputs: believed_contact (4, {0, 1}), contact now or at the previous control step.
    believed_touching (4, {0, 1}), contact now.
    State: the sensors' last readings, then the control steps since each changed (8).
    """

    def __init__(self) -> None:
        n = quadruped.N_LEGS
        super().__init__(
            inputs={"touching": n, "foot_height": n},
            outputs={"believed_contact": n, "believed_touching": n},
            memory=np.concatenate(ContactTrust.begin()).astype(float),
        )

    def step(self, memory: Array, touching: Array, foot_height: Array) -> tuple[Outputs, Array]:
        if np.isnan(touching[0]):
            return {"believed_contact": touching, "believed_touching": touching}, memory
        # A context holds floats, `ContactTrust` integers.
        reading, unchanged = np.split(memory.astype(np.int64), 2)
        before = ContactTrust(reading.astype(np.int8), unchanged)
        believed = believed_contacts(before, touching > 0.5, lambda: foot_height)
        outputs = {
            "believed_contact": believed.contact.astype(float),
            "believed_touching": believed.touching.astype(float),
        }
        return outputs, np.concatenate(believed.trust).astype(float)


class RewardMachineSystem(MealySystem):
    """Steps the gait's reward machine.

    .. pydrake_system::

        name: RewardMachineSystem
        input_ports: [foot_contact, foot_height, commanded_dwell]
        output_ports: [rm_state, rm_iterations, reward_multiplier, served_dwell]

    Inputs: foot_contact (4, {0, 1}), FL FR RL RR; while it is NaN the machine does not move.
    foot_height (4, m), above the ground. commanded_dwell (1, control steps).
    Outputs: rm_state (n_states, one-hot) and rm_iterations (1, control steps), after the current
    propositions. reward_multiplier (1), the factor on this step's plain reward. served_dwell (1,
    control steps), the commanded dwell of the transition that fires now; 0 without a transition.
    State: machine state, iterations in it, and control steps since the episode's start (3).
    """

    def __init__(self, gait: Gait) -> None:
        self._machine = RewardMachine(gait)
        super().__init__(
            inputs={
                "foot_contact": quadruped.N_LEGS,
                "foot_height": quadruped.N_LEGS,
                "commanded_dwell": 1,
            },
            outputs={
                "rm_state": gait.n_states,
                "rm_iterations": 1,
                "reward_multiplier": 1,
                "served_dwell": 1,
            },
            memory=np.ravel(self._machine.initial()).astype(float),
        )

    def step(
        self, memory: Array, foot_contact: Array, foot_height: Array, commanded_dwell: Array
    ) -> tuple[Outputs, Array]:
        stepped = self._machine.step(
            MachineState(*memory.astype(np.int64)),
            foot_contact=foot_contact > 0.5,
            foot_height=foot_height,
            commanded_dwell=commanded_dwell[0],
            moves=np.isfinite(foot_contact[0]),
        )
        outputs = {
            "rm_state": self._machine.one_hot(stepped.machine.state),
            "rm_iterations": [float(stepped.machine.iterations)],
            "reward_multiplier": [float(stepped.multiplier)],
            "served_dwell": [float(stepped.served_dwell)],
        }
        return outputs, np.ravel(stepped.machine).astype(float)


class Proprioception(FunctionSystem):
    """Assembles the part of the observation that needs no estimator.

    .. pydrake_system::

        name: Proprioception
        input_ports: [joints, command, commanded_dwell, previous_action, rm_state, rm_iterations,
          imu]
        output_ports: [proprioception]

    Inputs: joints (24; rad, rad/s), measured positions, then velocities. command (2; m/s, rad/s),
    forward speed and yaw rate, trunk frame. commanded_dwell (1, control steps). previous_action
    (12). rm_state (n_states, one-hot). rm_iterations (1, control steps). imu (9), the IMU's
    reading; the port exists only if the layout has an IMU.
    Outputs: proprioception (40 + n_states, 46 + n_states with an IMU), in the order of
    `ObservationLayout`.
    """

    def __init__(self, robot: Robot, layout: ObservationLayout, *, limited: bool = False) -> None:
        """If `limited`, clips the observed previous action to the joints' ranges."""
        super().__init__(
            inputs={
                "joints": 2 * N,
                "command": 2,
                "commanded_dwell": 1,
                "previous_action": N,
                "rm_state": layout.n_machine_states,
                "rm_iterations": 1,
                **({"imu": N_IMU} if layout.imu else {}),
            },
            outputs={"proprioception": layout.n_proprioceptive},
        )
        self._robot, self._limited = robot, limited

    def evaluate(
        self, joints: Array, rm_iterations: Array, commanded_dwell: Array, **others: Array
    ) -> Outputs:
        observed = proprioception(
            self._robot,
            joint_position=joints[:N],
            joint_velocity=joints[N:],
            rm_iterations=rm_iterations[0],
            commanded_dwell=commanded_dwell[0],
            limited=self._limited,
            **others,
        )
        return {"proprioception": observed}
