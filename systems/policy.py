"""Acts by a policy, neural or glass-box."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, InputPort, LeafSystem, OutputPort

from glassgait.models.errors import InputError
from glassgait.models.policies.policy import Policy, first_not_finite
from glassgait.models.robots import quadruped
from glassgait.models.task import CONTROL_PERIOD


class PolicySystem(LeafSystem):
    """Maps the observation to an action.

    .. pydrake_system::

        name: PolicySystem
        input_ports:
        - observation
        output_ports:
        - action

    Inputs: observation (47 + n_states), in the order of the policy's `observation_names`.
    Outputs: action (12), FL FR RL RR, hip thigh calf; 0.25 rad of joint target a unit.
    State: none; the policy is an immutable member that clones share. Feedthrough: yes.
    It knows numbers alone; `make_symbolic_policy` makes a system that converts to AutoDiffXd.
    Raises: InputError where the action of a finite observation is not finite; the plant would fail
    on it with an error that does not name the cause.
    """

    def __init__(self, policy: Policy) -> None:
        super().__init__()
        self._policy = policy
        self._observation_port = self.DeclareVectorInputPort(
            name="observation", size=len(policy.observation_names)
        )
        self._action_port = self.DeclareVectorOutputPort(
            name="action",
            size=quadruped.N_JOINTS,
            calc=self._calc_action,
            prerequisites_of_calc={self.all_input_ports_ticket()},
        )

    def get_observation_input_port(self) -> InputPort:
        """Takes the observation."""
        return self._observation_port

    def get_action_output_port(self) -> OutputPort:
        """Gives the action."""
        return self._action_port

    def _calc_action(self, context: Context, output: BasicVector) -> None:
        observation = self._observation_port.Eval(context)
        action = self._policy(observation)
        found = first_not_finite(action)
        # An observation that is not finite is a fault of the simulation, not of the policy.
        if found is not None and np.isfinite(observation).all():
            step = round(context.get_time() / CONTROL_PERIOD)
            raise InputError(
                f"the {self._policy.kind} policy's action of {quadruped.JOINTS[found[-1]]} is not "
                f"finite at control step {step}; give a policy that is"
            )
        output.SetFromVector(action)
