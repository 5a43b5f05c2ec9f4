"""A robot that walks at real time in a thread of its own, and a ghost that walks beside it."""

import math
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, replace

import numpy as np
from pydrake.geometry import Meshcat

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.live_display import LiveDisplay
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.visualization import open_meshcat
from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait
from glassgait.studies.studio.steered_robot import Sample, SteeredRobot, initial_command

KEPT = 400
"""Control steps that are kept (8 s)."""

SHOWN_EVERY = 2
"""Control steps from one picture to the next: 25 pictures a second."""

FALLEN_SECONDS = 1.0
"""Time that a robot lies before both are put back on their feet (s)."""

MOST_SCENARIOS = 64
"""Scenarios whose diagrams are kept: of both robots they take about 4 MiB each."""

PATIENCE = 0.25
"""Lag (s) beyond which lost time is not caught up with: the robot goes on from now."""


@dataclass(frozen=True)
class Moment:
    """Both robots at one control instant.

    Attributes:
        number: Control steps since the studio began, those before a fall included.
        robot: The robot.
        ghost: The ghost, if it walks.
    """

    number: int
    robot: Sample
    ghost: Sample | None


@dataclass
class Count:
    """What has been counted since the studio began.

    Attributes:
        steps: Control steps.
        late: Control steps that ended more than a control period after they should have.
        falls: Falls of the robot.
        ghost_falls: Falls of the ghost.
    """

    steps: int = 0
    late: int = 0
    falls: int = 0
    ghost_falls: int = 0


class LiveRobot:
    """Advances a robot and its ghost by the wall clock, and keeps what they did last.

    All that others ask for comes between two control steps, in the order in which they asked. A
    robot that falls lies for a second; then both begin anew, standing, with the next seed.
    """

    def __init__(
        self,
        gait: Gait,
        scenario: Scenario,
        controllers: tuple[AlternatingController, AlternatingController],
        *,
        drawn: bool = True,
        seed: int = 0,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        """
        Args:
            gait: The gait.
            scenario: The scenario in which both begin.
            controllers: The robot's and the ghost's.
            drawn: Whether they show in Meshcat.
            seed: Seed of noise and pushes, the same for both; each new beginning adds 1.
            clock: Gives the time (s).

        Raises:
            InputError: if a policy does not fit.
        """
        self._gait, self._controllers, self._drawn = gait, controllers, drawn
        self._seed, self._clock = seed, clock
        self._asked: deque[Callable[[], None]] = deque()
        self._stopping, self._woken = threading.Event(), threading.Event()
        self._lock = threading.Lock()
        self._moments: deque[Moment] = deque(maxlen=KEPT)
        self._fallen_at: int | None = None
        self._built: dict[tuple[Scenario, int], SteeredRobot] = {}
        self._known = {scenario}
        self._steps_asked, self._stops_at = 0, math.inf
        self._meshcat: Meshcat | None = None
        self._display: LiveDisplay | None = None
        self.address: Future[str] = Future()
        self.count = Count()
        self.steering = initial_command(gait)
        self.has_ghost = True
        self.paused = False
        self.problem: str | None = None
        self.scenario = scenario
        self._begin(scenario)
        self._thread = threading.Thread(target=self._live, name="live robot", daemon=True)

    def start(self) -> None:
        """Begins to walk; `address` then becomes that of Meshcat's page."""
        self._thread.start()

    def stop(self) -> None:
        """Ends for good."""
        self._stopping.set()
        self._woken.set()
        if self._thread.is_alive():
            self._thread.join()

    def ask(self, act: Callable[[], None]) -> None:
        """Has something done between two control steps, in the robot's thread."""
        self._asked.append(act)
        self._woken.set()

    def steer(self, steering: FixedCommand, *, lasts: float = math.inf) -> None:
        """Commands both robots from the next control step on.

        Args:
            steering: The command.
            lasts: Time after which both stop, unless they were commanded again (s).
        """

        def act() -> None:
            self._stops_at = self._clock() + lasts
            self._steer(steering)

        self.ask(act)

    def push(self, velocity: Array) -> None:
        """Pushes both robots: adds to the trunk's velocity (3; m/s, along its heading)."""

        def act() -> None:
            for robot in self._robots:
                robot.push(velocity)

        self.ask(act)

    def pause(self, paused: bool) -> None:
        """Halts time, or lets it go on."""

        def act() -> None:
            self.paused, self._steps_asked = paused, 0
            self.problem = None if not paused else self.problem

        self.ask(act)

    def step(self) -> None:
        """Advances by one control step while time is halted."""

        def act() -> None:
            # Counted, not done: what is asked for is also looked at in the midst of a step.
            self._steps_asked += self.paused

        self.ask(act)

    def restart(self, scenario: Scenario | None = None) -> None:
        """Puts both back on their feet, in another scenario if one is given.

        Raises:
            InputError: if diagrams of as many scenarios are kept as may be.
        """
        if scenario is not None and scenario not in self._known:
            if len(self._known) >= MOST_SCENARIOS:
                raise InputError(
                    f"the studio keeps {MOST_SCENARIOS} slopes and latencies, and no more; go back "
                    "to one of them, or start it anew"
                )
            self._known.add(scenario)
        self.ask(lambda: self._begin(scenario or self.scenario))

    def set_ghost(self, walks: bool) -> None:
        """Lets the ghost walk beside the robot, or not; both begin anew."""

        def act() -> None:
            self.has_ghost = walks
            self._begin(self.scenario)

        self.ask(act)

    def since(self, number: int) -> list[Moment]:
        """Returns the moments that are kept after a number, in order."""
        with self._lock:
            return [moment for moment in self._moments if moment.number > number]

    def latest(self, n_steps: int = KEPT) -> list[Moment]:
        """Returns the last moments, in order."""
        with self._lock:
            return list(self._moments)[-n_steps:]

    def _begin(self, scenario: Scenario) -> None:
        self._robots = [self._robot(scenario, own) for own in range(1 + self.has_ghost)]
        for robot in self._robots:
            robot.begin_anew(self._seed)
            robot.steer(self.steering)
        if scenario != self.scenario:
            self._display = None
        self.scenario, self._fallen_at = scenario, None

    def _steer(self, steering: FixedCommand) -> None:
        self.steering = steering
        for robot in self._robots:
            robot.steer(steering)

    def _robot(self, scenario: Scenario, own: int) -> SteeredRobot:
        """Returns the robot of a controller in a scenario, which is built only once.

        A diagram with systems of Python's is never freed: Drake holds their methods, and these
        hold the systems. So diagrams are kept for when they are needed again.
        """
        if (scenario, own) not in self._built:
            robot = SteeredRobot(self._gait, scenario, self._controllers[own], seed=self._seed)
            self._built[scenario, own] = robot
        return self._built[scenario, own]

    def _live(self) -> None:
        try:
            self._run()
        except BaseException as error:
            # A thread that ends by SystemExit, as Drake's aborts are, ends without a word.
            self.problem = f"the robot's thread has ended: {type(error).__name__}: {error}"
            raise

    def _run(self) -> None:
        if self._drawn:
            # Drake's Meshcat takes calls of the thread alone that made it.
            self._meshcat = open_meshcat()
            self.address.set_result(self._meshcat.web_url())
        due = self._clock()
        while not self._stopping.is_set():
            self._act()
            if self.paused:
                if self._steps_asked:
                    self._steps_asked -= 1
                    self._advance()
                else:
                    self._woken.wait(CONTROL_PERIOD)
                    self._woken.clear()
                due = self._clock()
                continue
            self._advance()
            due += CONTROL_PERIOD
            left = due - self._clock()
            self.count.late += left < -CONTROL_PERIOD
            if left < -PATIENCE:
                due = self._clock()
            elif left > 0:
                self._stopping.wait(left)

    def _act(self) -> None:
        while self._asked:
            act = self._asked.popleft()
            try:
                act()
            except InputError as error:
                self._halt(error)

    def _advance(self) -> None:
        if self._clock() >= self._stops_at:
            self._stops_at = math.inf
            self._steer(replace(self.steering, speed=0.0, yaw_rate=0.0))
        if self._fallen_at is not None:
            if self.count.steps - self._fallen_at >= FALLEN_SECONDS / CONTROL_PERIOD:
                self._seed += 1
                self._begin(self.scenario)
            else:
                self.count.steps += 1
                return
        try:
            for robot in self._robots:
                robot.advance()
            # What was asked for meanwhile acts in this instant's updates, before anything looks.
            self._act()
            robot, *ghost = [robot.sample() for robot in self._robots]
        except InputError as error:
            self._halt(error)
            return
        self.count.steps += 1
        moment = Moment(self.count.steps, robot, ghost[0] if ghost else None)
        with self._lock:
            self._moments.append(moment)
        self._note_falls(moment)
        if self._meshcat is not None and self.count.steps % SHOWN_EVERY == 0:
            self._draw(self._meshcat, moment)

    def _note_falls(self, moment: Moment) -> None:
        ghost_fell = moment.ghost is not None and moment.ghost.fallen
        self.count.falls += moment.robot.fallen
        self.count.ghost_falls += ghost_fell
        if moment.robot.fallen or ghost_fell:
            self._fallen_at = self.count.steps

    def _draw(self, meshcat: Meshcat, moment: Moment) -> None:
        if self._display is None:
            robot, terrain = self._controllers[0].robot, self.scenario.station.terrain
            self._display = LiveDisplay(robot, self._gait, meshcat, terrain=terrain)
        self._display.show(
            moment.robot.state,
            rm_state=moment.robot.rm_state,
            foot_contact=moment.robot.foot_contact,
            command=np.array([self.steering.speed, self.steering.yaw_rate]),
            ghost=None if moment.ghost is None else moment.ghost.state,
        )

    def _halt(self, error: InputError) -> None:
        """Halts time: what is asked for cannot be done, such as an action that is not finite."""
        self.problem, self.paused, self._steps_asked = str(error), True, 0
        self._seed += 1
        self._begin(self.scenario)
