"""The batch simulator: the locomotion task for hundreds of robots at once.

Physics runs in C++ threads; the task is the same batch-first functions of
`glassgait.models.task` that the systems diagram calls for one robot.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glassgait.diagrams.commands import DrawnCommands, FixedCommand
from glassgait.diagrams.physics import Physics, PhysicsStep
from glassgait.diagrams.task_config import TaskConfig
from glassgait.diagrams.task_state import BoolArray, TaskState
from glassgait.models.arrays import Array
from glassgait.models.estimation.contact import ContactTrust, read_contacts
from glassgait.models.estimation.imu import N_IMU, ImuReading, measure_imu
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.policies.controller import Estimator
from glassgait.models.robots import quadruped
from glassgait.models.task import COMMAND_STEPS, CONTROL_PERIOD
from glassgait.models.task.command import Command, sample_commands
from glassgait.models.task.ground import FootSense, sense_feet
from glassgait.models.task.observation import (
    N_ESTIMATED,
    ObservationLayout,
    body_state,
    proprioception,
)
from glassgait.models.task.reward import Reward, fall_speeds, step_reward, tracked_speeds
from glassgait.models.task.reward_machine import MachineStep, RewardMachine
from glassgait.models.task.termination import FAILURES, failures

NOT_FINITE = FAILURES.index("not_finite")


class BatchStep(NamedTuple):
    """What one control step brings, robots along the first axis.

    Attributes:
        reward: Reward with the machine's factor (n,).
        plain_reward: Reward without it (n,).
        terms: Weighted terms of the reward (n, 13).
        fired: Whether a transition of the machine fired (n,).
        served_dwell: Control steps of rhythm that the transition served (n,); see `MachineStep`.
        failures: Flags in the order of `glassgait.models.task.termination.FAILURES` (n, 7).
        terminated: Whether any failure showed (n,).
        truncated: Whether the episode reached its end (n,).
    """

    reward: Array
    plain_reward: Array
    terms: Array
    fired: BoolArray
    served_dwell: Array
    failures: BoolArray
    terminated: BoolArray
    truncated: BoolArray


class _Moved(NamedTuple):
    """Where one control step took robots; those that are lost stay as they were.

    Attributes:
        plant: Plant states (n, 37).
        touching: Whether each foot touches (n, 4).
        action: Actions that joints followed (n, 12).
        failures: Flags in the order of `FAILURES` (n, 7).
    """

    plant: Array
    touching: BoolArray
    action: Array
    failures: BoolArray

    @property
    def lost(self) -> BoolArray:
        """Which robots had no finite state, or no finite action to follow (n,)."""
        return self.failures[:, NOT_FINITE]


class _Contacts(NamedTuple):
    """Contacts as far as sensors are believed.

    Attributes:
        trust: Which sensors are believed.
        sensed: Which feet seem to press on the ground (n, 4).
        lasting: Which feet touch, or did at the step before (n, 4).
    """

    trust: ContactTrust
    sensed: BoolArray
    lasting: BoolArray


class BatchSimulator:
    """Plays the locomotion task with many robots.

    `step` advances all robots and leaves resets to the caller: a robot whose episode ended stays
    as it is until `reset` is called with its index.
    """

    def __init__(
        self,
        task: TaskConfig,
        physics: Physics,
        *,
        n_robots: int,
        generator: np.random.Generator,
        estimator: Estimator | None,
        difficulty: float = 1.0,
    ) -> None:
        """
        Args:
            task: The task.
            physics: The stepper.
            n_robots: Number of robots.
            generator: Source of all randomness.
            estimator: Odometry, or what maps proprioception (n, 40 + n_states) to the body state
                (n, 7), which is then what is observed and, a step later, what the reward machine
                takes the feet's heights from: the loop is closed on sensors only. None for the true
                ones; a policy's own is `estimator_in_loop`.
            difficulty: Factor on what the reward machine's transitions ask for; see
                `RewardMachine`.
        """
        self.task = task
        self.n_robots = n_robots
        self.generator = generator
        self.estimator = estimator
        self.difficulty = difficulty
        self.push_share = 1.0
        """Share of the pushes' speed that they have."""
        self.machine = RewardMachine(task.gait)
        self.layout = ObservationLayout(self.machine.n_states, imu=task.observes_imu)
        if (limits := task.joint_law.limits) is not None:
            limits.check(task.robot)
        needs_imu = isinstance(estimator, Odometry) or limits is not None
        self._has_imu = task.observes_imu or needs_imu
        self._weights = task.weights
        self._is_commanded = False
        self._all_robots = np.arange(n_robots)
        self._stand_on(physics)
        self._state: TaskState = self._fresh(self._all_robots)
        self.resample_friction()

    @property
    def state(self) -> TaskState:
        """All that the task remembers; change it with `restore`."""
        return self._state

    def restore(self, state: TaskState) -> None:
        """Continues from a state taken earlier."""
        self._state = state

    def change_ground(self, physics: Physics) -> None:
        """Goes on with other physics of the same robots, which stand on what is then under them.

        Args:
            physics: Physics of as many groups.
        """
        self._stand_on(physics)
        self.physics.set_friction(self.friction)
        plant = self._state.plant
        standing = self._ground.stand(self.task.robot, plant)
        plant = np.where(self._ground.is_rough[:, None], standing, plant)
        self._state = replace(self._state, plant=plant)

    def _stand_on(self, physics: Physics) -> None:
        self.physics = physics
        self.gravity = physics.gravity(self.n_robots)
        """Acceleration by gravity where each robot stands (n, 3; m/s²)."""
        self._ground = physics.ground(self.n_robots)

    def resample_friction(self) -> None:
        """Draws a new friction for every group of robots."""
        low, high = self.task.randomization.friction
        self.friction = self.generator.uniform(low, high, size=self.physics.n_groups)
        self.physics.set_friction(self.friction)

    def friction_of_robots(self) -> Array:
        """Returns the friction under each robot (n,)."""
        members = self.physics.members(self.n_robots)
        return np.repeat(self.friction, [len(group) for group in members])

    def restore_friction(self, friction: Array) -> None:
        """Sets the friction of every group (n_groups,)."""
        self.friction = friction
        self.physics.set_friction(friction)

    def reset(self, index: NDArray[np.int64] | None = None) -> None:
        """Starts a new episode for the robots at `index`, or for all."""
        if index is None:
            index = self._all_robots
        if len(index):
            self._state = self._state.with_robots(index, self._fresh(index))

    def start_at(self, plant: Array, command: Command) -> None:
        """Starts a new episode for all robots in given states and with given commands.

        Args:
            plant: Plant states x (n, 37).
            command: Velocities (n, 2) and dwells (n,).
        """
        self._state = self._begin(self._all_robots, plant, command)

    def set_command(self, command: Command) -> None:
        """Gives every robot a command: from then on episodes alone begin with drawn ones."""
        self._is_commanded = True
        self._state = self._estimated(replace(self._state, command=command))

    def proprioception(self) -> Array:
        """Observes the part that needs no estimator (n, 40 + n_states)."""
        return self._proprioception(self._state)

    def body_state(self) -> Array:
        """Returns the true values of what the estimator estimates (n, 7)."""
        return body_state(self.task.robot, self._state.plant, self._ground)

    def observe(self) -> Array:
        """Observes everything, the body state by the estimator or else by its true values.

        Returns:
            Observations (n, 47 + n_states), in the order of `layout`.
        """
        body = self.body_state() if self.estimator is None else self._state.estimate
        return np.concatenate([self.proprioception(), body], axis=-1)

    def limited(self, action: Array) -> Array:
        """Returns what the controllers' limits leave of actions (n, 12) that are asked for now."""
        limits, s = self.task.joint_law.limits, self._state
        if limits is None:
            return action
        position, _ = s.measured_joints()
        gravity = ImuReading.of(s.imu[:, -1]).gravity
        return limits.applied(
            self.task.robot, action, before=s.action, position=position, gravity=gravity
        )

    def step(self, action: Array) -> BatchStep:
        """Holds actions (n, 12), within limits, for one control step and moves the task on.

        Args:
            action: What controllers ask for.
        """
        s, task = self._state, self.task
        is_finite = np.isfinite(action).all(axis=1)
        moved = self._moved(s, self.limited(action), is_finite)
        steps = s.steps + 1
        joint_noise = self._joint_errors(s.bias)
        push = self.push_share * task.randomization.pushes(self.n_robots, self.generator)
        # A new command holds from the instant at which the step ends, for the machine too.
        command = self._commanded(s, steps)
        feet = sense_feet(task.robot, moved.plant, s.touching, moved.touching, self._ground)
        contacts = self._read_contacts(s, moved.plant, joint_noise, feet)
        machine = self._step_machine(s, feet, contacts.lasting, command)
        reward = self._rewarded(s, moved.plant, moved.action, command, feet)
        plain = np.where(moved.lost, 0.0, reward.plain)
        after = replace(
            s,
            plant=moved.plant,
            command=command,
            machine=machine.machine,
            touching=feet.touching,
            air_time=reward.air_time,
            fall_speed=reward.fall_speed,
            tracked=reward.tracked,
            action=moved.action,
            action_before=s.action,
            joint_noise=joint_noise,
            trust=contacts.trust,
            sensed=contacts.sensed,
            steps=steps,
        )
        # A push comes between two steps: the next observation shows it.
        self._state = self._estimated(
            self._sensed(after.pushed(push), self._all_robots, before=s.plant)
        )
        return BatchStep(
            reward=plain * machine.multiplier,
            plain_reward=plain,
            terms=reward.terms,
            fired=machine.fired,
            served_dwell=machine.served_dwell,
            failures=moved.failures,
            terminated=moved.failures.any(axis=1),
            truncated=steps >= task.episode_steps,
        )

    def _moved(self, s: TaskState, action: Array, is_finite: BoolArray) -> _Moved:
        """Moves robots by actions (n, 12) that were finite or not (n,), and looks for failures."""
        stepped = self._followed(s, action)
        shown = failures(
            self.task.robot,
            stepped.states,
            action=action,
            previous_action=s.action,
            limits=self.task.limits,
            ground=self._ground,
        )
        # A lost robot keeps its last sound state, so that nothing below meets a NaN. So does one
        # whose limits kept its targets, because not all that was asked is finite.
        shown[:, NOT_FINITE] |= ~is_finite
        kept = shown[:, NOT_FINITE, None]
        return _Moved(
            plant=np.where(kept, s.plant, stepped.states),
            touching=np.where(kept, s.touching, stepped.touching),
            action=np.where(kept, s.action, action),
            failures=shown,
        )

    def _read_contacts(
        self, s: TaskState, plant: Array, joint_noise: Array, feet: FootSense
    ) -> _Contacts:
        """Reads the feet's contact sensors, and believes those that are to be trusted."""
        wrong = self.task.randomization.wrong_contacts(self.n_robots, self.generator)
        reading = read_contacts(feet.touching, wrong, s.stuck)
        trust, lasting = s.trust.after(reading), s.trust.lasting(reading)
        if not trust.doubted.any():
            return _Contacts(trust, reading, lasting)
        height = self._expected_height(s, plant, joint_noise, feet)
        return _Contacts(trust, trust.believed(reading, height), trust.believed(lasting, height))

    def _rewarded(
        self, s: TaskState, plant: Array, action: Array, command: Command, feet: FootSense
    ) -> Reward:
        """Rewards the step from `s` to plant states (n, 37) by sound actions (n, 12)."""
        return step_reward(
            self.task.robot,
            state=plant,
            previous_joint_velocity=s.plant[:, quadruped.JOINT_VELOCITY],
            action=action,
            previous_action=s.action,
            command=command.velocity,
            foot_contact=feet.contact,
            foot_height=feet.height,
            air_time=s.air_time,
            fall_speed=s.fall_speed,
            tracked=s.tracked,
            weights=self._weights,
            joint_law=self.task.joint_law,
        )

    def _followed(self, s: TaskState, action: Array) -> PhysicsStep:
        """Lets the joints follow actions (n, 12) as late as they come, for a control period."""
        very_late = s.latency > CONTROL_PERIOD
        coming = np.where(very_late[:, None], s.action, action)
        held = np.where(very_late[:, None], s.action_before, s.action)
        robot, limited = self.task.robot, self.task.joint_law.limited
        return self.physics.step(
            s.plant,
            robot.joint_targets(coming, limited=limited),
            previous_targets=robot.joint_targets(held, limited=limited),
            latency=np.where(very_late, s.latency - CONTROL_PERIOD, s.latency),
        )

    def _joint_errors(self, bias: Array) -> Array:
        """Draws errors of measured joints (n, 24; rad, rad/s) around constant ones (n, 21)."""
        errors = self.task.randomization.joint_noise(len(bias), self.generator)
        errors[:, : quadruped.N_JOINTS] += bias[:, : quadruped.N_JOINTS]
        return errors

    def _step_machine(
        self, s: TaskState, feet: FootSense, contact: BoolArray, command: Command
    ) -> MachineStep:
        return self.machine.step(
            s.machine,
            foot_contact=contact,
            foot_height=self._sensed_height(feet, s.estimate),
            commanded_dwell=command.dwell,
            difficulty=self.difficulty,
        )

    def _commanded(self, state: TaskState, steps: NDArray[np.int64]) -> Command:
        """Returns what is commanded once each robot's control steps (n,) are over."""
        due = np.flatnonzero(steps % COMMAND_STEPS == 0)
        if len(due) and not self._is_commanded:
            state = state.with_commands(due, self._draw_commands(len(due)))
        return state.command

    def _draw_commands(self, count: int) -> Command:
        match self.task.command:
            case FixedCommand() as fixed:
                return fixed.of_robots(count)
            case DrawnCommands(speed_range=speed_range):
                straight = self.task.randomization.straight
                return sample_commands(
                    self.task.gait, count, self.generator, speed_range, straight=straight
                )

    def _fresh(self, index: NDArray[np.int64]) -> TaskState:
        count = len(index)
        ground = self._ground.of_robots(index)
        plant = self.task.randomization.initial_states(
            self.task.robot, count, self.generator, ground
        )
        return self._begin(index, plant, self._draw_commands(count))

    def _begin(self, index: NDArray[np.int64], plant: Array, command: Command) -> TaskState:
        count = len(plant)
        randomization = self.task.randomization
        untouched = np.zeros((count, quadruped.N_LEGS), dtype=bool)
        ground = self._ground.of_robots(index)
        feet = sense_feet(self.task.robot, plant, untouched, ground=ground)
        wrong = randomization.wrong_contacts(count, self.generator)
        stuck = randomization.stuck_contacts(count, self.generator)
        reading = read_contacts(feet.touching, wrong, stuck)
        nothing, no_speed = np.zeros((count, N_ESTIMATED)), np.zeros((count, quadruped.N_LEGS))
        start = self.machine.step(
            self.machine.initial((count,)),
            foot_contact=reading,
            foot_height=self._sensed_height(feet, nothing),
            commanded_dwell=command.dwell,
            difficulty=self.difficulty,
        )
        bias = randomization.biases(count, self.generator)
        joint_noise = self._joint_errors(bias)
        measured = plant[:, quadruped.JOINT_POSITION] + joint_noise[:, : quadruped.N_JOINTS]
        begun = TaskState(
            plant=plant,
            command=command,
            machine=start.machine,
            touching=feet.touching,
            air_time=np.zeros((count, quadruped.N_LEGS)),
            fall_speed=fall_speeds(self.task.robot, plant, feet.contact, no_speed, self._weights),
            tracked=tracked_speeds(plant, np.zeros((count, 2)), self._weights),
            action=np.zeros((count, quadruped.N_JOINTS)),
            action_before=np.zeros((count, quadruped.N_JOINTS)),
            joint_noise=joint_noise,
            bias=bias,
            imu=np.zeros((count, 1 + randomization.imu.delay, N_IMU)),
            stuck=stuck,
            trust=ContactTrust.begin((count,)).after(reading),
            sensed=reading,
            latency=randomization.latencies(count, self.generator),
            estimate=nothing,
            odometry=Odometry().begin(self.task.robot, measured),
            steps=np.zeros(count, dtype=np.int64),
        )
        return self._estimated(self._sensed(begun, index))

    def _proprioception(self, s: TaskState) -> Array:
        return proprioception(
            self.task.robot,
            command=s.command.velocity,
            joint_position=s.plant[:, quadruped.JOINT_POSITION],
            joint_velocity=s.plant[:, quadruped.JOINT_VELOCITY],
            previous_action=s.action,
            rm_state=self.machine.one_hot(s.machine.state),
            rm_iterations=s.machine.iterations,
            commanded_dwell=s.command.dwell,
            joint_noise=s.joint_noise,
            imu=s.imu[:, -1] if self.layout.imu else None,
            limited=self.task.joint_law.limited,
        )

    def _sensed(
        self, state: TaskState, index: NDArray[np.int64], before: Array | None = None
    ) -> TaskState:
        """Returns a state that is about to be observed, with what the IMU and odometry then give.

        Args:
            state: The state.
            index: Its robots.
            before: Plant states one control step before (n, 37); None at an episode's start.
        """
        if not self._has_imu:
            return state
        earlier = state.plant if before is None else before
        reading = measure_imu(
            state.plant,
            earlier[:, quadruped.LINEAR_VELOCITY],
            self.gravity[index],
        )
        reading += self.task.randomization.imu_noise(len(index), self.generator)
        reading += state.bias[:, quadruped.N_JOINTS :]
        if before is None:
            return replace(state, imu=np.repeat(reading[:, None], state.imu.shape[1], axis=1))
        readings = np.concatenate([reading[:, None], state.imu[:, :-1]], axis=1)
        state = replace(state, imu=readings)
        if not isinstance(self.estimator, Odometry):
            return state
        position, velocity = state.measured_joints()
        odometry = self.estimator.advance(
            self.task.robot,
            state.odometry,
            joint_position=position,
            joint_velocity=velocity,
            imu=readings[:, -1],
            touching=state.sensed,
        )
        return replace(state, odometry=odometry)

    def _estimated(self, state: TaskState) -> TaskState:
        """Returns a state that is about to be observed, with what the estimator then gives."""
        match self.estimator:
            case None:
                return state
            case Odometry() as odometry:
                position, _ = state.measured_joints()
                estimate = odometry.body_state(self.task.robot, state.odometry, position)
            case network:
                estimate = network(self._proprioception(state))
        return replace(state, estimate=estimate)

    def _expected_height(
        self, before: TaskState, plant: Array, joint_noise: Array, feet: FootSense
    ) -> Array:
        """Returns how high feet are (n, 4; m) before it is known which of them touch."""
        if not isinstance(self.estimator, Odometry):
            return self._sensed_height(feet, before.estimate)
        position = plant[:, quadruped.JOINT_POSITION] + joint_noise[:, : quadruped.N_JOINTS]
        return self.estimator.expected_heights(self.task.robot, before.odometry, position)

    def _sensed_height(self, feet: FootSense, estimate: Array) -> Array:
        # The estimator sees the machine's state, so the machine reads what it estimated before.
        return feet.height if self.estimator is None else estimate[:, -quadruped.N_LEGS :]
