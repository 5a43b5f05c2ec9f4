"""The reward of a control step, and the failures that end an episode."""

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import DEFAULT_LAW, JointLaw, Robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.ground import LEVEL_GROUND, Ground
from glassgait.models.task.reward import REWARD_TERMS, RewardWeights, step_reward
from glassgait.models.task.termination import FAILURES, TerminationLimits, failures
from glassgait.systems.base import STATE, FunctionSystem, MealySystem, Outputs

N = quadruped.N_JOINTS


class RewardSystem(MealySystem):
    """Evaluates the reward of the control step that ends now.

    .. pydrake_system::

        name: RewardSystem
        input_ports: [state, command, action, previous_action, foot_contact, foot_height,
          reward_multiplier]
        output_ports: [reward, plain_reward, reward_terms]

    Inputs: state (37), the plant's. command (2; m/s, rad/s). action (12), held during the step.
    previous_action (12). foot_contact (4, {0, 1}). foot_height (4, m), above the ground.
    reward_multiplier (1), the reward machine's.
    Outputs: reward (1), with the machine's factor. plain_reward (1), without it. reward_terms (12),
    weighted, in the order of `REWARD_TERMS`. All are valid from the end of the first control step.
    State, of the previous control step: joint velocities (12; rad/s), air times of the feet (4; s)
    and the speeds that the tracking terms compare with the command (2; m/s, rad/s).
    """

    def __init__(
        self, robot: Robot, weights: RewardWeights | None = None, joint_law: JointLaw = DEFAULT_LAW
    ) -> None:
        n = quadruped.N_LEGS
        # The update at time 0, before the first control step, raises the air times to zero.
        air_time = np.full(n, -CONTROL_PERIOD)
        super().__init__(
            inputs={
                "state": STATE,
                "command": 2,
                "action": N,
                "previous_action": N,
                "foot_contact": n,
                "foot_height": n,
                "reward_multiplier": 1,
            },
            outputs={"reward": 1, "plain_reward": 1, "reward_terms": len(REWARD_TERMS)},
            memory=np.concatenate([np.zeros(N), air_time, np.zeros(2)]),
        )
        self._robot, self._weights, self._law = robot, weights or RewardWeights(), joint_law

    def step(
        self,
        memory: Array,
        state: Array,
        reward_multiplier: Array,
        foot_contact: Array,
        **others: Array,
    ) -> tuple[Outputs, Array]:
        joint_velocity, air_time, tracked = np.split(memory, [N, N + 4])
        reward = step_reward(
            self._robot,
            state=state,
            previous_joint_velocity=joint_velocity,
            foot_contact=foot_contact > 0.5,
            air_time=air_time,
            tracked=tracked,
            weights=self._weights,
            joint_law=self._law,
            **others,
        )
        outputs = {
            "reward": reward.plain * reward_multiplier,
            "plain_reward": [float(reward.plain)],
            "reward_terms": reward.terms,
        }
        # The next step computes the joints' acceleration from this velocity.
        velocity = state[quadruped.JOINT_VELOCITY]
        return outputs, np.concatenate([velocity, reward.air_time, reward.tracked])


class FallMonitor(FunctionSystem):
    """Detects the robot's failures.

    .. pydrake_system::

        name: FallMonitor
        input_ports: [state, action, previous_action, is_sound]
        output_ports: [failures]

    Inputs: state (37), the plant's. action (12), held during the last control step.
    previous_action (12). is_sound (1, {0, 1}), whether the latest asked action is finite.
    Outputs: failures (7, {0, 1}), in the order of `FAILURES`.
    """

    def __init__(
        self, robot: Robot, limits: TerminationLimits | None = None, ground: Ground = LEVEL_GROUND
    ) -> None:
        super().__init__(
            inputs={"state": STATE, "action": N, "previous_action": N, "is_sound": 1},
            outputs={"failures": len(FAILURES)},
        )
        # Public, since rollouts read a diagram's robot and ground here.
        self.robot, self.ground = robot, ground
        self._limits = limits or TerminationLimits()

    def evaluate(
        self, state: Array, action: Array, previous_action: Array, is_sound: Array
    ) -> Outputs:
        flags = failures(
            self.robot,
            state,
            action=action,
            previous_action=previous_action,
            limits=self._limits,
            ground=self.ground,
        )
        flags[FAILURES.index("not_finite")] |= is_sound[0] < 0.5
        return {"failures": flags.astype(float)}
