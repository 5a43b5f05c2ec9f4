"""A robot that walks in real time in its own thread, and a ghost that walks beside it."""

import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import begin_anew, make_simulator, push, recenter
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.visualization import LiveDisplay, open_meshcat
from glassgait.models.arrays import Array
from glassgait.models.policies.controller import Controller
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait
from glassgait.models.task.termination import FAILURES
from glassgait.studies.common.rollouts import pusher

KEPT_SAMPLES = 250  # control steps whose samples are kept (5 s)
SHOWN_EVERY = 2  # control steps from one picture to the next: 25 pictures a second
FALLEN_STEPS = 50  # control steps from a fall to the restart of both robots
MAX_LAG = 0.25  # lag (s) beyond which the robots do not catch up with real time


class ExchangeablePolicy(Policy):
    """Delegates to the policy in `acting`, which may be exchanged between two control steps.

    Exchanged policies differ only in their formulas.
    """

    kind = "exchangeable"

    def __init__(self, acting: Policy) -> None:
        super().__init__(acting.gait, acting.observation_names, robot=acting.robot)
        self.joint_law, self.machine = acting.joint_law, acting.machine
        self.observes_by, self._estimator = acting.observes_by, acting.estimator
        self.acting = acting

    def act(self, observation: Array) -> Array:
        return self.acting.act(observation)

    def digest(self) -> str:
        return self.acting.digest()


class Sample(NamedTuple):
    """Outputs of a robot's diagram at a control instant, by the names of their ports."""

    state: Array
    rm_state: Array
    foot_contact: Array
    observation: Array
    action: Array
    reward: Array
    failures: Array

    @property
    def fallen(self) -> bool:
        return bool((self.failures > 0.5).any())


class _Walker:
    def __init__(self, gait: Gait, scenario: Scenario, controller: Controller) -> None:
        self._scenario = scenario
        self._diagram = MakeLocomotion(gait, scenario, policy=controller)
        self._simulator = make_simulator(self._diagram)
        self._context = self._simulator.get_mutable_context()
        # Look up ports once: pydrake's look-ups fail while another thread iterates over objects.
        self._outputs = [self._diagram.GetOutputPort(name) for name in Sample._fields]
        self._command = self._diagram.GetInputPort("command")
        self._dwell = self._diagram.GetInputPort("commanded_dwell")

    def begin(self, seed: int, command: FixedCommand) -> None:
        """Resets the robot, with the noise and the scenario's pushes of a seed."""
        begin_anew(self._simulator, seed=seed)
        self._pushed = pusher(self._simulator, self._scenario, seed)
        self._step = 0
        self.steer(command)

    def steer(self, command: FixedCommand) -> None:
        self._command.FixValue(self._context, [command.speed, command.yaw_rate])
        self._dwell.FixValue(self._context, [float(command.dwell)])

    def push(self, velocity: Array) -> None:
        """Adds to the velocity of the trunk (3; m/s, along its heading)."""
        quaternion = self.sample().state[quadruped.QUATERNION]
        forward = kinematics.rotation_matrix(quaternion)[:, 0]
        cosine, sine = forward[:2] / np.linalg.norm(forward[:2])
        turned = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        push(self._diagram, self._context, turned @ velocity)

    def advance(self) -> None:
        self._pushed()
        self._step += 1
        if not self._scenario.station.terrain.is_plane:
            recenter(self._diagram, self._context)
        self._simulator.AdvanceTo(self._step * CONTROL_PERIOD)

    def sample(self) -> Sample:
        return Sample(*(np.array(port.Eval(self._context)) for port in self._outputs))


class LiveRobot:
    """Advances a robot and its ghost in real time, and keeps their last samples.

    The ghost acts by the policy before all edits. Requests are executed between two control steps,
    in order. If either robot falls, both restart after a second with the next seed.

    Attributes:
        address: Address of Meshcat's page once the thread runs.
        problem: Why the robot stopped, or None.
        falls: Falls of the robot and of the ghost.
        late: Share of recent control steps that were late, from 0 to 1.
    """

    def __init__(
        self, gait: Gait, scenario: Scenario, controller: Controller, *, seed: int = 0
    ) -> None:
        self._gait, self._scenario, self._robot, self._seed = gait, scenario, controller.robot, seed
        # The first walker is the robot, and the second one the ghost.
        self._edited = ExchangeablePolicy(controller.policy)
        controllers = (replace(controller, student=self._edited, period=0), controller)
        self._walkers = [_Walker(gait, scenario, each) for each in controllers]

        # Requests to the thread, and its results.
        self._requests: deque[Callable[[], object]] = deque()
        self._stopping = threading.Event()
        self._samples: deque[tuple[Sample, Sample]] = deque(maxlen=KEPT_SAMPLES)
        self._lying = 0
        self.address: Future[str] = Future()
        self.steering = FixedCommand(0.5 * gait.max_speed, 0.0, sum(gait.dwell) // 2)
        self.paused = False
        self.problem: str | None = None
        self.falls, self.late = [0, 0], 0.0
        self._begin()
        self._thread = threading.Thread(target=self._live, name="live robot", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join()

    def act_by(self, policy: Policy) -> None:
        self._requests.append(lambda: setattr(self._edited, "acting", policy))

    def steer(self, command: FixedCommand) -> None:
        """Commands both robots; the loop limits commands to the gait's range."""
        self.steering = command
        self._requests.append(lambda: [walker.steer(command) for walker in self._walkers])

    def push(self, velocity: Array) -> None:
        """Adds to the velocity of both trunks (3; m/s, along their headings)."""
        self._requests.append(lambda: [walker.push(velocity) for walker in self._walkers])

    def pause(self, paused: bool) -> None:
        self.paused, self.problem = paused, None

    def restart(self) -> None:
        self._requests.append(self._begin)

    def samples(self) -> list[tuple[Sample, Sample]]:
        return list(self._samples)

    def _begin(self) -> None:
        self._lying = 0
        for walker in self._walkers:
            walker.begin(self._seed, self.steering)

    def _live(self) -> None:
        try:
            self._run()
        except BaseException as error:
            # SystemExit, which Drake's aborts raise, would end the thread silently.
            self.problem = f"the robot's thread has ended: {type(error).__name__}: {error}"
            raise

    def _run(self) -> None:
        # Meshcat takes calls only from the thread that made it.
        meshcat = open_meshcat()
        terrain = self._scenario.station.terrain
        display = LiveDisplay(self._robot, self._gait, meshcat, terrain=terrain)
        self.address.set_result(meshcat.web_url())
        due, step = time.perf_counter(), 0
        while not self._stopping.is_set():
            due += CONTROL_PERIOD
            self.answer()
            if not self.paused and self.advance():
                step += 1
                if step % SHOWN_EVERY == 0:
                    robot, ghost = self._samples[-1]
                    marks = {"rm_state": robot.rm_state, "foot_contact": robot.foot_contact}
                    display.show(robot.state, **marks, ghost=ghost.state)

            # Wait for the next control instant. After a long lag, skip the lost time.
            remaining = due - time.perf_counter()
            self.late += 0.01 * ((remaining < -CONTROL_PERIOD) - self.late)
            if remaining < -MAX_LAG:
                due = time.perf_counter()
            elif remaining > 0:
                self._stopping.wait(remaining)

    def answer(self) -> None:
        while self._requests:
            self._requests.popleft()()

    def advance(self) -> bool:
        """Advances both robots by a control step; returns False while they do not move."""
        # After a fall, both robots wait for a second.
        if self._lying:
            self._lying -= 1
            if self._lying == 0:
                self._seed += 1
                self._begin()
            return False
        for walker in self._walkers:
            walker.advance()
        robot, ghost = (walker.sample() for walker in self._walkers)
        # Pause at an action that is not finite; the page shows the problem.
        if (robot.failures + ghost.failures)[FAILURES.index("not_finite")]:
            self.problem = "a target is not finite; change the formula, which may divide by 0"
            self.paused = True
            self._begin()
            return False
        self._samples.append((robot, ghost))
        self.falls = [self.falls[0] + robot.fallen, self.falls[1] + ghost.fallen]
        if robot.fallen or ghost.fallen:
            self._lying = FALLEN_STEPS
        return True
