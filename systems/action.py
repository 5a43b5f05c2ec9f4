"""Systems from the observation to the joints: policies, alternation, limits, hold and targets."""

import math
from typing import TYPE_CHECKING

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, InputPortIndex, LeafSystem, State

from glassgait.models.arrays import Array
from glassgait.models.estimation.sensors import N_IMU, ImuReading
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot, TargetLimits
from glassgait.models.task import CONTROL_PERIOD
from glassgait.systems.base import FunctionSystem, MealySystem, Outputs

if TYPE_CHECKING:
    from glassgait.models.policies.policy import Policy

N = quadruped.N_JOINTS


class PolicySystem(FunctionSystem):
    """Maps the observation to an action.

    .. pydrake_system::

        name: PolicySystem
        input_ports: [observation]
        output_ports: [action]

    Inputs: observation (n), in the order of the policy's `observation_names`, or its memory of
    observations (see `PolicyMemory`).
    Outputs: action (12), FL FR RL RR, hip thigh calf; NaN where the policy has no valid answer.
    Contexts and clones share the policy, which is immutable.
    """

    def __init__(self, policy: "Policy") -> None:
        super().__init__(inputs={"observation": policy.n_memory}, outputs={"action": N})
        self._policy = policy

    def evaluate(self, observation: Array) -> Outputs:
        return {"action": self._policy(observation)}


class PolicyMemory(MealySystem):
    """Remembers observations for a policy that acts on several.

    .. pydrake_system::

        name: PolicyMemory
        input_ports: [observation]
        output_ports: [memory]

    Inputs: observation (n), in the order of the policy's `observation_names`.
    Outputs: memory (n_memory), on which the policy acts; see `Policy.remember`.
    State: the memory of the previous control step, latched every 20 ms.
    """

    def __init__(self, policy: "Policy") -> None:
        size = policy.n_memory
        super().__init__(
            inputs={"observation": len(policy.observation_names)},
            outputs={"memory": size},
            memory=np.full(size, np.nan),
        )
        self._policy = policy

    def step(self, memory: Array, observation: Array) -> tuple[Outputs, Array]:
        after = self._policy.remember(memory, observation)
        return {"memory": after}, after


class AlternationSchedule(LeafSystem):
    """Lets the expert act every n-th control step (paper, Algorithm 1).

    Its output selects an input of Drake's `PortSwitch`, which evaluates only the selected policy.

    .. pydrake_system::

        name: AlternationSchedule
        output_ports: [port_selector]

    Outputs: port_selector (abstract, InputPortIndex), the port of the expert or of the student, as
    a function of time.
    """

    def __init__(
        self, period: int, expert_port: InputPortIndex, student_port: InputPortIndex
    ) -> None:
        """Sets the expert's period (control steps); with period 0 only the student acts."""
        super().__init__()
        self._period, self._expert, self._student = period, expert_port, student_port
        self.DeclareAbstractOutputPort(
            name="port_selector",
            alloc=lambda: AbstractValue.Make(InputPortIndex(0)),
            calc=self._calc_port_selector,
            prerequisites_of_calc={self.time_ticket()},
        )

    def _calc_port_selector(self, context: Context, output: AbstractValue) -> None:
        step = round(context.get_time() / CONTROL_PERIOD)
        by_expert = self._period > 0 and step % self._period == 0
        output.set_value(self._expert if by_expert else self._student)


class TargetLimitsSystem(FunctionSystem):
    """Applies the final limits between a policy and the joints; see `TargetLimits`.

    .. pydrake_system::

        name: TargetLimitsSystem
        input_ports: [action, previous_action, joints, imu]
        output_ports: [limited_action]

    Inputs: action (12), the policy's output. previous_action (12), within the limits. Without
    limits, the system has no ports joints (24; rad, rad/s), the measured positions, then
    velocities, and imu (9), the IMU's reading.
    Outputs: limited_action (12), the previous action if `action` is not finite.
    """

    def __init__(self, robot: Robot, limits: TargetLimits | None) -> None:
        sensed = {} if limits is None else {"joints": 2 * N, "imu": N_IMU}
        super().__init__(
            inputs={"action": N, "previous_action": N, **sensed}, outputs={"limited_action": N}
        )
        self._robot, self._limits = robot, limits
        if limits is not None:
            # Actions start at the default stance, so the limits must allow it.
            limits.check(robot)

    def evaluate(self, action: Array, previous_action: Array, **sensed: Array) -> Outputs:
        if self._limits is None:
            finite = np.isfinite(action).all()
            return {"limited_action": action if finite else previous_action}
        limited = self._limits.applied(
            self._robot,
            action,
            before=previous_action,
            position=sensed["joints"][:N],
            gravity=ImuReading.of(sensed["imu"]).gravity,
        )
        return {"limited_action": limited}


class ActionHold(LeafSystem):
    """Holds the action between control steps and delays it on its way to the joints.

    The action is latched in an unrestricted update, which precedes the plant's discrete update of
    the same instant, so an action without latency acts at once. Drake's `ZeroOrderHold` latches in
    a discrete update, one plant step later.

    .. pydrake_system::

        name: ActionHold
        input_ports: [asked_action, action]
        output_ports: [held_action, previous_action, is_sound, delayed_action]

    Inputs: asked_action (12), before limits. action (12), within limits.
    Outputs: held_action (12), the latest action; previous_action (12), the action before it;
    delayed_action (12), the held action of `latency` seconds ago. All are zero at first. is_sound
    (1, {0, 1}), whether the latest asked action is finite.
    State: the latest two actions and is_sound, latched every 20 ms. With a latency also the
    delayed action and the queue behind it, latched `latency` after each control instant.
    """

    def __init__(self, latency: float = 0.0, time_step: float = CONTROL_PERIOD) -> None:
        """Sets the latency (s; at most two control periods) and the plant's time step (s).

        The latency is a whole number of time steps.
        """
        super().__init__()

        # State: the latest two actions, and whether the last asked action was finite.
        self._asked_port = self.DeclareVectorInputPort("asked_action", N)
        self._action_port = self.DeclareVectorInputPort("action", N)
        self._actions = self.DeclareDiscreteState(np.append(np.zeros(2 * N), 1.0))
        self._declare_output("held_action", slice(N))
        self._declare_output("previous_action", slice(N, 2 * N))
        self._declare_output("is_sound", slice(2 * N, None))
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period_sec=CONTROL_PERIOD, offset_sec=0.0, update=self._latch
        )

        # The action that the joints follow.
        if latency == 0.0:
            self._declare_output("delayed_action", slice(N))
            return
        # With a latency above one period, an action waits while its successor is latched.
        n_waiting = math.ceil(latency / CONTROL_PERIOD - 1e-9) - 1
        self._delayed = self.DeclareDiscreteState(N)
        self._waiting = self.DeclareDiscreteState(n_waiting * N)
        self.DeclareStateOutputPort("delayed_action", self._delayed)
        # Update with the plant's period: events of another period and offset differ from the
        # plant's by rounding errors, so their order would be random.
        self._step, self._phase = time_step, round(latency / time_step)
        self._n_steps = round(CONTROL_PERIOD / time_step)
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period_sec=time_step, offset_sec=0.0, update=self._pass_on
        )

    def _declare_output(self, name: str, entries: slice) -> None:
        def calc(context: Context, output: BasicVector) -> None:
            output.SetFromVector(context.get_discrete_state(self._actions).value()[entries])

        size = len(range(2 * N + 1)[entries])
        self.DeclareVectorOutputPort(
            name=name, size=size, calc=calc, prerequisites_of_calc={self.xd_ticket()}
        )

    def _latch(self, context: Context, state: State) -> None:
        held = context.get_discrete_state(self._actions).value()[:N]
        is_sound = np.isfinite(self._asked_port.Eval(context)).all()
        latest = np.concatenate([self._action_port.Eval(context), held, [is_sound]])
        state.get_mutable_discrete_state(self._actions).SetFromVector(latest)

    def _pass_on(self, context: Context, state: State) -> None:
        step = round(context.get_time() / self._step)
        if (step - self._phase) % self._n_steps:
            return
        held = context.get_discrete_state(self._actions).value()[:N]
        waiting = context.get_discrete_state(self._waiting).value()
        delayed, waiting = np.split(np.concatenate([waiting, held]), [N])
        state.get_mutable_discrete_state(self._delayed).SetFromVector(delayed)
        state.get_mutable_discrete_state(self._waiting).SetFromVector(waiting)


class JointTargets(FunctionSystem):
    """Converts an action to the plant's desired state.

    .. pydrake_system::

        name: JointTargets
        input_ports: [action]
        output_ports: [desired_state]

    Inputs: action (12), in the order of `quadruped.JOINTS`.
    Outputs: desired_state (24; rad, rad/s), target positions, then zero velocities, in the order of
    the plant's actuators.
    """

    def __init__(self, robot: Robot, actuated_joints: list[str], *, limited: bool = False) -> None:
        """Sets the robot and the joint names in the order of the plant's actuators."""
        super().__init__(inputs={"action": N}, outputs={"desired_state": 2 * N})
        self._robot, self._limited = robot, limited
        self._order = [quadruped.JOINTS.index(name) for name in actuated_joints]

    def evaluate(self, action: Array) -> Outputs:
        targets = self._robot.joint_targets(action, limited=self._limited)[self._order]
        return {"desired_state": np.concatenate([targets, np.zeros(N)])}
