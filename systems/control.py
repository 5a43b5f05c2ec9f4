"""Systems between a robot's sensors and its joints, one for each part of the control step."""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, InputPortIndex, LeafSystem, State

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.estimation.odometry import Odometry, OdometryState
from glassgait.models.estimation.sensors import N_IMU, ContactTrust, ImuReading, believed_contacts
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot, TargetLimits
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import N_ESTIMATED, ObservationLayout, proprioception
from glassgait.models.task.reward_machine import MachineState, RewardMachine
from glassgait.systems.base import FunctionSystem, MealySystem, Outputs

if TYPE_CHECKING:
    from glassgait.models.policies.policy import Policy

N = quadruped.N_JOINTS

FOOT_HEIGHT = slice(-quadruped.N_LEGS, None)
"""Foot heights in the body state, and in what an estimator remembers."""


class ContactTrustSystem(MealySystem):
    """Finds which feet touch, whatever a stuck contact sensor reads; see `ContactTrust`.

    .. pydrake_system::

        name: ContactTrustSystem
        input_ports: [touching, foot_height]
        output_ports: [believed_contact, believed_touching]

    Inputs: touching (4, {0, 1}), FL FR RL RR, what the sensors read at this instant. foot_height
    (4, m), estimated before it is known which feet touch.
    Outputs: believed_contact (4, {0, 1}), which feet touch now or did at the previous control step.
    believed_touching (4, {0, 1}), which feet touch now.
    State: what the sensors read, then for how many control steps they have not changed (8).
    """

    def __init__(self) -> None:
        n = quadruped.N_LEGS
        super().__init__(
            inputs={"touching": n, "foot_height": n},
            outputs={"believed_contact": n, "believed_touching": n},
            memory=np.concatenate(ContactTrust.begin()).astype(float),
        )

    def step(self, memory: Array, touching: Array, foot_height: Array) -> tuple[Outputs, Array]:
        # Contexts hold floats, contacts are counted in integers.
        reading, unchanged = np.split(memory.astype(np.int64), 2)
        before = ContactTrust(reading.astype(np.int8), unchanged)
        believed = believed_contacts(before, touching > 0.5, lambda: foot_height)
        outputs = {
            "believed_contact": believed.contact.astype(float),
            "believed_touching": believed.touching.astype(float),
        }
        return outputs, np.concatenate(believed.trust).astype(float)


class StateEstimator(MealySystem):
    """Estimates the body state from what the robot measures or knows.

    .. pydrake_system::

        name: StateEstimator
        input_ports: [proprioception]
        output_ports: [body_state, previous_foot_height]

    Inputs: proprioception (40 + n_states), in the order of `ObservationLayout`.
    Outputs: body_state (7), base linear velocity scaled by 2 (m/s, trunk frame) and foot heights
    (m). previous_foot_height (4, m), those heights at the control instant before; zero at first. A
    reward machine that reads them closes no loop with an estimator that sees its state.
    State: the foot heights.
    """

    def __init__(self, estimator: Callable[[Array], Array], n_proprioceptive: int) -> None:
        """Takes what maps proprioception (40 + n_states) to the body state (7)."""
        super().__init__(
            inputs={"proprioception": n_proprioceptive},
            outputs={"body_state": N_ESTIMATED},
            memory=np.zeros(quadruped.N_LEGS),
        )
        self._estimator = estimator
        declare_previous_foot_height(self)

    def step(self, memory: Array, proprioception: Array) -> tuple[Outputs, Array]:
        body_state = self._estimator(proprioception)
        return {"body_state": body_state}, body_state[FOOT_HEIGHT]


class OdometrySystem(MealySystem):
    """Estimates the body state from the IMU, the joints and the feet that stand.

    .. pydrake_system::

        name: OdometrySystem
        input_ports: [joints, imu, touching]
        output_ports: [body_state, previous_foot_height, expected_foot_height]

    Inputs: joints (24; rad, rad/s), measured positions, then velocities. imu (9), the reading.
    touching (4, {0, 1}), FL FR RL RR, which feet seem to press on the ground at this instant.
    Outputs: body_state (7), base linear velocity scaled by 2 (m/s, trunk frame) and foot heights
    above the plane of the footholds (m). previous_foot_height (4, m), those heights at the control
    instant before, as `StateEstimator` has them. expected_foot_height (4, m), of this instant,
    before it is known which feet touch; both are zero at first.
    State: whether there is an instant before (1), what odometry remembers of it (3 m/s, 12 m, 4,
    3 rad/s), and its foot heights (4, m). Feedthrough: all inputs to body_state, joints to
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
        # Contacts are read by it, so that it must not depend on them.
        self.DeclareVectorOutputPort(
            name="expected_foot_height",
            size=quadruped.N_LEGS,
            calc=self._calc_expected_foot_height,
            prerequisites_of_calc={self._ports["joints"].ticket(), self.xd_ticket()},
        )

    def step(
        self, memory: Array, joints: Array, imu: Array, touching: Array
    ) -> tuple[Outputs, Array]:
        # At first there is nothing to integrate from: the robot is taken to be at rest.
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

        # Remember it for the next step, flat, as a context holds numbers.
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
    """Declares an output of the foot heights that an estimator's memory ends with."""

    def calc(context: Context, output: BasicVector) -> None:
        output.SetFromVector(system.memory(context)[FOOT_HEIGHT])

    system.DeclareVectorOutputPort(
        name="previous_foot_height",
        size=quadruped.N_LEGS,
        calc=calc,
        prerequisites_of_calc={system.xd_ticket()},
    )


def _unpacked(memory: Array) -> OdometryState | None:
    """Returns what odometry remembers of the instant before; None if there was none."""
    begun, velocity, footholds, touching, turning, _ = np.split(memory, [1, 4, 16, 20, 23])
    if begun[0] < 0.5:
        return None
    return OdometryState(velocity, footholds.reshape(-1, 3), touching > 0.5, turning)


class RewardMachineSystem(MealySystem):
    """Steps the gait's reward machine.

    .. pydrake_system::

        name: RewardMachineSystem
        input_ports: [foot_contact, foot_height, commanded_dwell]
        output_ports: [rm_state, rm_iterations, reward_multiplier, served_dwell]

    Inputs: foot_contact (4, {0, 1}), FL FR RL RR. foot_height (4, m), above the ground.
    commanded_dwell (1, control steps).
    Outputs: rm_state (n_states, one-hot) and rm_iterations (1, control steps), after this instant's
    propositions. reward_multiplier (1), the factor on this step's plain reward. served_dwell (1,
    control steps), the share of commanded_dwell that the transition of this instant stands for, 0
    where none fired.
    State: machine state, iterations and age after the previous control step (3).
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
        )
        outputs = {
            "rm_state": self._machine.one_hot(stepped.machine.state),
            "rm_iterations": [float(stepped.machine.iterations)],
            "reward_multiplier": [float(stepped.multiplier)],
            "served_dwell": [float(stepped.served_dwell)],
        }
        return outputs, np.ravel(stepped.machine).astype(float)


class Proprioception(FunctionSystem):
    """Assembles the part of the observation that the robot measures or knows.

    .. pydrake_system::

        name: Proprioception
        input_ports: [joints, command, commanded_dwell, previous_action, rm_state, rm_iterations,
          imu]
        output_ports: [proprioception]

    Inputs: joints (24; rad, rad/s), measured positions, then velocities. command (2; m/s, rad/s),
    forward speed and yaw rate, trunk frame. commanded_dwell (1, control steps). previous_action
    (12). rm_state (n_states, one-hot). rm_iterations (1, control steps). imu (9), the reading, only
    where the layout has an IMU.
    Outputs: proprioception (40 + n_states, 46 + n_states with an IMU), in the order of
    `ObservationLayout`.
    """

    def __init__(self, robot: Robot, layout: ObservationLayout, *, limited: bool = False) -> None:
        """Observes the previous action within the joints' ranges if targets are `limited`."""
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


class PolicySystem(FunctionSystem):
    """Maps the observation to an action.

    .. pydrake_system::

        name: PolicySystem
        input_ports: [observation]
        output_ports: [action]

    Inputs: observation (n), in the order of the policy's `observation_names`.
    Outputs: action (12), FL FR RL RR, hip thigh calf.
    The policy is an immutable member that contexts and clones share. An action of a finite
    observation that is not finite raises an InputError; the plant would fail on it with an error
    that does not name the cause.
    """

    def __init__(self, policy: "Policy") -> None:
        super().__init__(
            inputs={"observation": len(policy.observation_names)}, outputs={"action": N}
        )
        self._policy = policy

    def evaluate(self, observation: Array) -> Outputs:
        action = self._policy(observation)
        diverged = np.flatnonzero(~np.isfinite(action))
        # An observation that is not finite is a fault of the simulation, not of the policy.
        if len(diverged) and np.isfinite(observation).all():
            raise InputError(
                f"the {self._policy.kind} policy's action of {quadruped.JOINTS[diverged[0]]} is "
                "not finite; give a policy that is"
            )
        return {"action": action}


class AlternationSchedule(LeafSystem):
    """Lets the expert act every n-th control step (paper, Algorithm 1).

    Its output selects an input of Drake's `PortSwitch`, which evaluates only the policy that acts.

    .. pydrake_system::

        name: AlternationSchedule
        output_ports: [port_selector]

    Outputs: port_selector (abstract, InputPortIndex), the expert's port or the student's; a
    function of time.
    """

    def __init__(
        self, period: int, expert_port: InputPortIndex, student_port: InputPortIndex
    ) -> None:
        """Takes the expert's period (control steps); with 0 only the student acts."""
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
    """Applies the limits that come last between a policy and the joints; see `TargetLimits`.

    .. pydrake_system::

        name: TargetLimitsSystem
        input_ports: [action, previous_action, joints, imu]
        output_ports: [limited_action]

    Inputs: action (12), as the policy asks for it. previous_action (12), within the limits. joints
    (24; rad, rad/s), measured positions, then velocities. imu (9), the IMU's reading.
    Outputs: limited_action (12).
    """

    def __init__(self, robot: Robot, limits: TargetLimits) -> None:
        # Actions begin at the default stance, which the limits have to allow.
        limits.check(robot)
        super().__init__(
            inputs={"action": N, "previous_action": N, "joints": 2 * N, "imu": N_IMU},
            outputs={"limited_action": N},
        )
        self._robot, self._limits = robot, limits

    def evaluate(self, action: Array, previous_action: Array, joints: Array, imu: Array) -> Outputs:
        limited = self._limits.applied(
            self._robot,
            action,
            before=previous_action,
            position=joints[:N],
            gravity=ImuReading.of(imu).gravity,
        )
        return {"limited_action": limited}


class ActionHold(LeafSystem):
    """Holds the action between two control steps, and passes it on to the joints some time later.

    It latches in an unrestricted update, before the plant's discrete update of the same instant:
    an action without latency acts at once. Drake's `ZeroOrderHold` latches in a discrete update, a
    plant step late.

    .. pydrake_system::

        name: ActionHold
        input_ports: [action]
        output_ports: [held_action, previous_action, delayed_action]

    Inputs: action (12).
    Outputs: held_action (12), the latest; previous_action (12), the one before it; delayed_action
    (12), the one that was the latest `latency` seconds ago. All are zero at first.
    State: the latest two actions, latched every 20 ms; with a latency the delayed one and those
    that wait to follow it, latched `latency` after a control instant.
    """

    def __init__(self, latency: float = 0.0, time_step: float = 0.0) -> None:
        """Takes the latency (s), up to two control periods, in whole steps of a discrete plant (s).

        A continuous plant has time step 0.
        """
        super().__init__()

        # The latest two actions.
        self._action_port = self.DeclareVectorInputPort("action", N)
        self._actions = self.DeclareDiscreteState(2 * N)
        for name, part in (("held_action", slice(0, N)), ("previous_action", slice(N, 2 * N))):
            self._declare_part(name, part)
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period_sec=CONTROL_PERIOD, offset_sec=0.0, update=self._latch
        )

        # The action that the joints follow.
        if latency == 0.0:
            self._declare_part("delayed_action", slice(0, N))
            return
        # Within a period an action may be passed on; else it waits until the next one has come.
        waiting = math.ceil(latency / CONTROL_PERIOD - 1e-9) - 1
        self._delayed = self.DeclareDiscreteState(N)
        self._waiting = self.DeclareDiscreteState(waiting * N)
        self.DeclareStateOutputPort("delayed_action", self._delayed)
        if time_step:
            # Updates at the plant's instants: those of another period and offset would differ from
            # them by rounding errors, and come before or after the plant's at random.
            self._step, self._phase = time_step, round(latency / time_step)
            self._n_steps = round(CONTROL_PERIOD / time_step)
            self.DeclarePeriodicUnrestrictedUpdateEvent(
                period_sec=time_step, offset_sec=0.0, update=self._pass_on_in_phase
            )
        else:
            self.DeclarePeriodicUnrestrictedUpdateEvent(
                period_sec=CONTROL_PERIOD,
                offset_sec=latency % CONTROL_PERIOD,
                update=self._pass_on,
            )

    def _declare_part(self, name: str, part: slice) -> None:
        def calc(context: Context, output: BasicVector) -> None:
            output.SetFromVector(context.get_discrete_state(self._actions).value()[part])

        self.DeclareVectorOutputPort(
            name=name, size=N, calc=calc, prerequisites_of_calc={self.xd_ticket()}
        )

    def _latch(self, context: Context, state: State) -> None:
        held = context.get_discrete_state(self._actions).value()[:N]
        latest = np.concatenate([self._action_port.Eval(context), held])
        state.get_mutable_discrete_state(self._actions).SetFromVector(latest)

    def _pass_on_in_phase(self, context: Context, state: State) -> None:
        step = round(context.get_time() / self._step)
        if (step - self._phase) % self._n_steps == 0:
            self._pass_on(context, state)

    def _pass_on(self, context: Context, state: State) -> None:
        held = context.get_discrete_state(self._actions).value()[:N]
        waiting = context.get_discrete_state(self._waiting).value()
        passed, waiting = np.split(np.concatenate([waiting, held]), [N])
        state.get_mutable_discrete_state(self._delayed).SetFromVector(passed)
        state.get_mutable_discrete_state(self._waiting).SetFromVector(waiting)


class JointTargets(FunctionSystem):
    """Maps an action to the plant's desired state.

    .. pydrake_system::

        name: JointTargets
        input_ports: [action]
        output_ports: [desired_state]

    Inputs: action (12), in the order of `quadruped.JOINTS`.
    Outputs: desired_state (24; rad, rad/s), target positions, then zero velocities, in the order of
    the plant's actuators.
    """

    def __init__(self, robot: Robot, actuated_joints: list[str], *, limited: bool = False) -> None:
        """Takes the joints' names in the order of the plant's actuators."""
        super().__init__(inputs={"action": N}, outputs={"desired_state": 2 * N})
        self._robot, self._limited = robot, limited
        self._order = [quadruped.JOINTS.index(name) for name in actuated_joints]

    def evaluate(self, action: Array) -> Outputs:
        targets = self._robot.joint_targets(action, limited=self._limited)[self._order]
        return {"desired_state": np.concatenate([targets, np.zeros(N)])}
