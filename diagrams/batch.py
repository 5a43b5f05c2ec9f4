"""The batch simulator: the locomotion task for hundreds of robots at once.

Physics runs in C++ threads; `glassgait.models.control` computes the control step.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glassgait.diagrams.commands import DrawnCommands, FixedCommand
from glassgait.diagrams.physics import Physics, PhysicsStep
from glassgait.diagrams.task import TaskConfig, TaskState, read_sensors, replaced
from glassgait.models.arrays import Array, map_arrays
from glassgait.models.control import BoolArray, ControlStep
from glassgait.models.estimation.sensors import N_IMU, measure_imu, read_contacts
from glassgait.models.policies.controller import Estimator
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.task import COMMAND_STEPS, CONTROL_PERIOD
from glassgait.models.task.command import Command, sample_commands
from glassgait.models.task.ground import FootSense, body_state, sense_feet
from glassgait.models.task.observation import ObservationLayout
from glassgait.models.task.reward import Reward, step_reward, tracked_speeds
from glassgait.models.task.reward_machine import RewardMachine
from glassgait.models.task.termination import FAILURES, failures

NOT_FINITE = FAILURES.index("not_finite")


class BatchStep(NamedTuple):
    """Outcome of a control step, robots along the first axis."""

    reward: Array  # with the machine's factor (n,)
    plain_reward: Array  # without it (n,)
    terms: Array  # weighted (n, 12)
    fired: BoolArray  # whether a transition fired (n,)
    served_dwell: Array  # control steps (n,); see `MachineStep`
    failures: BoolArray  # in the order of `FAILURES` (n, 7)
    terminated: BoolArray  # whether any failure showed (n,)
    truncated: BoolArray  # whether the episode reached its end (n,)


class _Moved(NamedTuple):
    """Robots after a control period of physics; lost robots keep their previous state."""

    plant: Array
    touching: BoolArray
    action: Array
    failures: BoolArray
    lost: BoolArray


class BatchSimulator:
    """Simulates the locomotion task with many robots; the caller resets robots at episode ends."""

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
        """Without an estimator, observes the true body state; see `RewardMachine` on difficulty."""
        self.task, self.n_robots, self.generator = task, n_robots, generator
        self.estimator, self.difficulty = estimator, difficulty
        self.push_share = 1.0  # factor on the speed of pushes

        # The control step of all robots.
        self.machine = RewardMachine(task.gait)
        self.layout = ObservationLayout(task.gait.n_states, imu=task.observes_imu)
        if (limits := task.joint_law.limits) is not None:
            limits.check(task.robot)
        self.control = ControlStep(
            task.robot, self.machine, task.joint_law, estimator, task.observes_imu
        )

        # The robots at the start of their first episode.
        self._is_commanded = False
        self._all_robots = np.arange(n_robots)
        self._set_physics(physics)
        self._state: TaskState = self._draw_start(self._all_robots)
        self.resample_friction()

    @property
    def state(self) -> TaskState:
        """The state of the task; change it with `restore`."""
        return self._state

    def restore(self, state: TaskState) -> None:
        """Continues from an earlier state."""
        self._state = state

    def change_ground(self, physics: Physics) -> None:
        """Replaces the physics, keeping the number of groups, and puts robots on its ground."""
        self._set_physics(physics)
        self.physics.set_friction(self.friction)
        plant = self._state.plant
        standing = self._ground.stand(self.task.robot, plant)
        plant = np.where(self._ground.is_rough[:, None], standing, plant)
        self._state = self._state._replace(plant=plant)

    def _set_physics(self, physics: Physics) -> None:
        self.physics = physics
        self.gravity = physics.gravity(self.n_robots)  # acceleration (n, 3; m/s²)
        self._ground = physics.ground(self.n_robots)

    def resample_friction(self) -> None:
        """Draws a new friction for every group of robots."""
        low, high = self.task.randomization.friction
        self.restore_friction(self.generator.uniform(low, high, size=self.physics.n_groups))

    def friction_of_robots(self) -> Array:
        """Returns the friction under each robot (n,)."""
        return self.physics.per_robot(self.friction, self.n_robots)

    def restore_friction(self, friction: Array) -> None:
        """Sets the friction of every group (n_groups,)."""
        self.friction = friction
        self.physics.set_friction(friction)

    def reset(self, index: NDArray[np.int64] | None = None) -> None:
        """Starts a new episode for the robots at `index`, or for all."""
        if index is None:
            index = self._all_robots
        if len(index):
            self._state = self._state.with_robots(index, self._draw_start(index))

    def start_at(self, plant: Array, command: Command) -> None:
        """Starts a new episode of all robots from plant states x (n, 37) with given commands."""
        self._state = self._begin(self._all_robots, plant, command)

    def set_command(self, command: Command) -> None:
        """Commands every robot; from now on commands are drawn only at the start of episodes."""
        self._is_commanded = True
        s = self._state._replace(command=command)
        # A learned estimator observes the command.
        self._state = s._replace(memory=self.control.estimated(s.memory, s.sensors(), command))

    def proprioception(self) -> Array:
        """Returns the part of the observation that needs no estimator (n, 40 + n_states)."""
        s = self._state
        return self.control.proprioception(s.memory, s.sensors(), s.command)

    def body_state(self) -> Array:
        """Returns the true body state (n, 7)."""
        return body_state(self.task.robot, self._state.plant, self._ground)

    def observe(self) -> Array:
        """Returns the observation (n, 47 + n_states), in the order of `layout`."""
        s, body = self._state, self.body_state() if self.estimator is None else None
        return self.control.observation(s.memory, s.sensors(), s.command, body)

    def limited(self, action: Array) -> Array:
        """Applies the controllers' limits to actions (n, 12)."""
        return self.control.limited(self._state.memory, self._state.sensors(), action)

    def step(self, action: Array) -> BatchStep:
        """Limits the actions (n, 12), and advances the task by one control step with them."""
        s, task = self._state, self.task
        moved = self._move(s, self.limited(action), np.isfinite(action).all(axis=1))

        # Draw noise, pushes and commands of the next instant. A new command takes effect at the
        # end of the step, also for the reward machine.
        steps = s.steps + 1
        joint_noise = self._draw_joint_errors(s.bias)
        push = self.push_share * task.randomization.pushes(self.n_robots, self.generator)
        command = self._next_command(s, steps)
        wrong = task.randomization.wrong_contacts(self.n_robots, self.generator)

        # Reward the step, before the push.
        feet = sense_feet(task.robot, moved.plant, s.touching, moved.touching, self._ground)
        reward = self._reward(s, moved, command, feet)
        plain = np.where(moved.lost, 0.0, reward.plain)

        # Sense the state after the push, and step the reward machine.
        after = s._replace(
            plant=moved.plant,
            command=command,
            touching=feet.touching,
            air_time=reward.air_time,
            tracked=reward.tracked,
            action_before=s.memory.action,
            joint_noise=joint_noise,
            steps=steps,
        ).pushed(push)
        if self.control.needs_imu:
            reading = self._read_imu(after.plant, s.plant, s.bias, self._all_robots)
            imu = np.concatenate([reading[:, None], s.imu[:, :-1]], axis=1)
            after = after._replace(imu=imu)
        memory, machine = self.control.sense(
            s.memory._replace(action=moved.action),
            after.sensors(read_contacts(feet.touching, wrong, s.stuck)),
            command,
            true_height=feet.height if self.estimator is None else None,
            difficulty=self.difficulty,
        )
        self._state = after._replace(memory=memory)
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

    def _move(self, s: TaskState, action: Array, is_finite: BoolArray) -> _Moved:
        """Moves robots by limited actions (n, 12) whose asked actions are finite or not (n,)."""
        stepped = self._step_physics(s, action)
        flags = failures(
            self.task.robot,
            stepped.states,
            action=action,
            previous_action=s.memory.action,
            limits=self.task.limits,
            ground=self._ground,
        )
        # A lost robot keeps its last finite state, so that no NaN reaches the code below.
        lost = flags[:, NOT_FINITE].copy()
        flags[:, NOT_FINITE] |= ~is_finite
        return _Moved(
            plant=np.where(lost[:, None], s.plant, stepped.states),
            touching=np.where(lost[:, None], s.touching, stepped.touching),
            action=action,
            failures=flags,
            lost=lost,
        )

    def _step_physics(self, s: TaskState, action: Array) -> PhysicsStep:
        """Advances physics by a control period with actions (n, 12) delayed by the latency."""
        # With a latency above one period, the previous action arrives in this period.
        is_long = s.latency > CONTROL_PERIOD
        last = s.memory.action
        arriving = np.where(is_long[:, None], last, action)
        held = np.where(is_long[:, None], s.action_before, last)
        return self.physics.step(
            s.plant,
            self.control.joint_targets(arriving),
            previous_targets=self.control.joint_targets(held),
            latency=np.where(is_long, s.latency - CONTROL_PERIOD, s.latency),
        )

    def _reward(self, s: TaskState, moved: _Moved, command: Command, feet: FootSense) -> Reward:
        # The new command counts, which takes effect at the end of the step.
        return step_reward(
            self.task.robot,
            state=moved.plant,
            previous_joint_velocity=s.plant[:, quadruped.JOINT_VELOCITY],
            action=moved.action,
            previous_action=s.memory.action,
            command=command.velocity,
            foot_contact=feet.contact,
            foot_height=feet.height,
            air_time=s.air_time,
            tracked=s.tracked,
            weights=self.task.weights,
            joint_law=self.task.joint_law,
        )

    def _draw_joint_errors(self, bias: Array) -> Array:
        """Draws joint measurement errors (n, 24; rad, rad/s) around constant biases (n, 21)."""
        errors = self.task.randomization.joint_noise(len(bias), self.generator)
        errors[:, : quadruped.N_JOINTS] += bias[:, : quadruped.N_JOINTS]
        return errors

    def _read_imu(
        self, plant: Array, before: Array, bias: Array, index: NDArray[np.int64]
    ) -> Array:
        """Measures with the IMUs (n, 9) of robots at `index`, from current and previous states."""
        velocity = before[:, quadruped.LINEAR_VELOCITY]
        reading = measure_imu(plant, velocity, self.gravity[index])
        reading += self.task.randomization.imu_noise(len(index), self.generator)
        reading += bias[:, quadruped.N_JOINTS :]
        return reading

    def _next_command(self, state: TaskState, steps: NDArray[np.int64]) -> Command:
        """Returns the commands after the given numbers of control steps (n,)."""
        due = np.flatnonzero(steps % COMMAND_STEPS == 0)
        if len(due) and not self._is_commanded:
            drawn = self._draw_commands(len(due))
            return map_arrays(lambda values, new: replaced(values, due, new), state.command, drawn)
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

    def _draw_start(self, index: NDArray[np.int64]) -> TaskState:
        """Draws states and commands of robots at the start of an episode."""
        robot, ground = self.task.robot, self._ground.of_robots(index)
        draw = self.task.randomization.initial_states
        plant = draw(robot, len(index), self.generator, ground)
        return self._begin(index, plant, self._draw_commands(len(index)))

    def _begin(self, index: NDArray[np.int64], plant: Array, command: Command) -> TaskState:
        """Returns the state of robots at the start of an episode."""
        count, task, randomization = len(plant), self.task, self.task.randomization
        no_legs = np.zeros((count, quadruped.N_LEGS))
        no_action, no_speeds = np.zeros((count, quadruped.N_JOINTS)), np.zeros((count, 2))
        ground = self._ground.of_robots(index)
        feet = sense_feet(task.robot, plant, no_legs > 0.0, ground=ground)

        # Draw sensor errors and latencies.
        wrong = randomization.wrong_contacts(count, self.generator)
        stuck = randomization.stuck_contacts(count, self.generator)
        bias = randomization.biases(count, self.generator)
        joint_noise = self._draw_joint_errors(bias)
        latency = randomization.latencies(count, self.generator)
        imu = np.zeros((count, 1 + randomization.imu.delay, N_IMU))
        if self.control.needs_imu:
            imu[:] = self._read_imu(plant, plant, bias, index)[:, None]

        # Read the sensors for the first time.
        reading = read_contacts(feet.touching, wrong, stuck)
        memory, _ = self.control.sense(
            None,
            read_sensors(plant, joint_noise, reading, imu),
            command,
            true_height=feet.height if self.estimator is None else None,
            difficulty=self.difficulty,
        )
        return TaskState(
            plant=plant,
            command=command,
            memory=memory,
            touching=feet.touching,
            air_time=no_legs,
            tracked=tracked_speeds(*kinematics.base_velocity(plant), no_speeds, task.weights),
            action_before=no_action,
            joint_noise=joint_noise,
            bias=bias,
            imu=imu,
            stuck=stuck,
            latency=latency,
            steps=np.zeros(count, dtype=np.int64),
        )
