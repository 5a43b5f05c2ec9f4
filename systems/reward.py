"""Rewards the last control step."""

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    InputPort,
    LeafSystem,
    OutputPort,
    State,
)

from glassgait.models.robots import quadruped
from glassgait.models.robots.joint_law import OWN_LAW, JointLaw
from glassgait.models.robots.robot import Robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.reward import REWARD_TERMS, Reward, RewardWeights, step_reward
from glassgait.systems.cached_value import CachedValue


class RewardSystem(LeafSystem):
    """Evaluates the reward of the control step that ends now.

    .. pydrake_system::

        name: RewardSystem
        input_ports:
        - state
        - command
        - action
        - previous_action
        - foot_contact
        - foot_height
        - reward_multiplier
        output_ports:
        - reward
        - plain_reward
        - reward_terms

    Inputs: state (37), the plant's. command (2; m/s, rad/s). action (12), held during the step.
    previous_action (12). foot_contact (4, {0, 1}). foot_height (4, m), above the ground.
    reward_multiplier (1), the reward machine's.
    Outputs: reward (1), with the machine's factor. plain_reward (1), without it. reward_terms (13),
    weighted, in the order of `REWARD_TERMS`.
    They mean something from the end of the first control step on.
    State: joint velocities, the feet's air times and speeds of fall, and the speeds that were
    compared with the command, at the previous control step, latched every 20 ms (unrestricted
    update). Feedthrough: all inputs; reward_multiplier to reward alone.
    """

    def __init__(
        self,
        robot: Robot,
        weights: RewardWeights | None = None,
        *,
        joint_law: JointLaw = OWN_LAW,
    ) -> None:
        """
        Args:
            robot: The robot.
            weights: Weights of the terms.
            joint_law: How the joints follow targets.
        """
        super().__init__()
        self._robot = robot
        self._weights = weights or RewardWeights()
        self._joint_law = joint_law
        self._joint_velocity = self.DeclareDiscreteState(quadruped.N_JOINTS)
        # The update at time 0 precedes the first control step; it brings the air time to zero.
        self._air_time = self.DeclareDiscreteState(np.full(quadruped.N_LEGS, -CONTROL_PERIOD))
        self._fall_speed = self.DeclareDiscreteState(quadruped.N_LEGS)
        self._tracked = self.DeclareDiscreteState(2)
        declare = self.DeclareVectorInputPort
        self._state_port = declare("state", quadruped.N_POSITIONS + quadruped.N_VELOCITIES)
        self._command_port = declare("command", 2)
        self._action_port = declare("action", quadruped.N_JOINTS)
        self._previous_action_port = declare("previous_action", quadruped.N_JOINTS)
        self._foot_contact_port = declare("foot_contact", quadruped.N_LEGS)
        self._foot_height_port = declare("foot_height", quadruped.N_LEGS)
        self._reward_multiplier_port = declare("reward_multiplier", 1)
        step_ports = (
            self._state_port,
            self._command_port,
            self._action_port,
            self._previous_action_port,
            self._foot_contact_port,
            self._foot_height_port,
        )
        # All outputs and the update come from one evaluation; the factor is not part of it.
        self._evaluation = CachedValue(
            self,
            "plain reward and its terms",
            self._calc_evaluation,
            {
                self.xd_ticket(),
                *(self.input_port_ticket(port.get_index()) for port in step_ports),
            },
        )
        of_step = {self._evaluation.ticket()}
        multiplier_ticket = self.input_port_ticket(self._reward_multiplier_port.get_index())
        self._reward_port = self.DeclareVectorOutputPort(
            name="reward",
            size=1,
            calc=self._calc_reward,
            prerequisites_of_calc=of_step | {multiplier_ticket},
        )
        self._plain_reward_port = self.DeclareVectorOutputPort(
            name="plain_reward",
            size=1,
            calc=self._calc_plain_reward,
            prerequisites_of_calc=of_step,
        )
        self._reward_terms_port = self.DeclareVectorOutputPort(
            name="reward_terms",
            size=len(REWARD_TERMS),
            calc=self._calc_reward_terms,
            prerequisites_of_calc=of_step,
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period_sec=CONTROL_PERIOD, offset_sec=0.0, update=self._latch
        )

    def get_state_input_port(self) -> InputPort:
        """Takes the plant's state."""
        return self._state_port

    def get_command_input_port(self) -> InputPort:
        """Takes forward speed and yaw rate."""
        return self._command_port

    def get_action_input_port(self) -> InputPort:
        """Takes the action held during the step."""
        return self._action_port

    def get_previous_action_input_port(self) -> InputPort:
        """Takes the action of the step before."""
        return self._previous_action_port

    def get_foot_contact_input_port(self) -> InputPort:
        """Takes which feet touch."""
        return self._foot_contact_port

    def get_foot_height_input_port(self) -> InputPort:
        """Takes how high the feet are."""
        return self._foot_height_port

    def get_reward_multiplier_input_port(self) -> InputPort:
        """Takes the reward machine's factor."""
        return self._reward_multiplier_port

    def get_reward_output_port(self) -> OutputPort:
        """Gives the reward with the machine's factor."""
        return self._reward_port

    def get_plain_reward_output_port(self) -> OutputPort:
        """Gives the reward without the machine's factor."""
        return self._plain_reward_port

    def get_reward_terms_output_port(self) -> OutputPort:
        """Gives the weighted terms."""
        return self._reward_terms_port

    def _calc_evaluation(self, context: Context) -> Reward:
        return step_reward(
            self._robot,
            state=self._state_port.Eval(context),
            previous_joint_velocity=context.get_discrete_state(self._joint_velocity).value(),
            action=self._action_port.Eval(context),
            previous_action=self._previous_action_port.Eval(context),
            command=self._command_port.Eval(context),
            foot_contact=self._foot_contact_port.Eval(context) > 0.5,
            foot_height=self._foot_height_port.Eval(context),
            air_time=context.get_discrete_state(self._air_time).value(),
            fall_speed=context.get_discrete_state(self._fall_speed).value(),
            tracked=context.get_discrete_state(self._tracked).value(),
            weights=self._weights,
            joint_law=self._joint_law,
        )

    def _calc_reward(self, context: Context, output: BasicVector) -> None:
        multiplier = self._reward_multiplier_port.Eval(context)
        output.SetFromVector(self._evaluation.Eval(context).plain * multiplier)

    def _calc_plain_reward(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([float(self._evaluation.Eval(context).plain)])

    def _calc_reward_terms(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._evaluation.Eval(context).terms)

    def _latch(self, context: Context, state: State) -> None:
        velocity = self._state_port.Eval(context)[quadruped.JOINT_VELOCITY]
        reward = self._evaluation.Eval(context)
        state.get_mutable_discrete_state(self._joint_velocity).SetFromVector(velocity)
        state.get_mutable_discrete_state(self._air_time).SetFromVector(reward.air_time)
        state.get_mutable_discrete_state(self._fall_speed).SetFromVector(reward.fall_speed)
        state.get_mutable_discrete_state(self._tracked).SetFromVector(reward.tracked)
