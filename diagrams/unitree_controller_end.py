"""The controller's end of Unitree's wire, which may be a process of its own."""

import time
from collections.abc import Callable

import numpy as np

from glassgait.diagrams.acting import Acting
from glassgait.diagrams.answering import Answering, AnsweringEnd
from glassgait.diagrams.linked_controller import MakeAnsweringController
from glassgait.diagrams.self_test import predict_self_test
from glassgait.diagrams.station import StationConfig
from glassgait.models.link.dds import Endpoint
from glassgait.models.link.low_state import (
    CONTROL_TICKS,
    PERIOD,
    Gathered,
    foot_force_of,
    joints_of,
    sensors_of,
)
from glassgait.models.link.message_filter import StateFilter
from glassgait.models.link.messages import command_t, sensors_t
from glassgait.models.link.motors import MotorCommand, pack_low_cmd
from glassgait.models.link.operator import Operator
from glassgait.models.link.packing import (
    pack_command,
    unpack_answer,
    unpack_imu,
    unpack_joints,
    unpack_touching,
)
from glassgait.models.link.remote import Button, Remote, read_remote
from glassgait.models.link.self_test import Prediction, Recording
from glassgait.models.link.supervision import (
    Fault,
    Stage,
    Supervision,
    commanded,
    initial_course,
    step_course,
)
from glassgait.models.link.unitree_messages import Record
from glassgait.models.link.watchdog import CROUCH
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.request import NO_MODE

FREE = Remote.untouched()

LEAVING = 0.5
"""Time for which a controller that ends damps its robot (s)."""


class UnitreeControllerEnd(AnsweringEnd):
    """Drives the motors of a robot by what its LowState messages say.

    Each batch of states that came is answered by one LowCmd; every 20 ms of the robot's clock the
    controller is asked for new targets. See `glassgait.models.link.supervision` for what joints do.

    Attributes:
        diagram: What `MakeAnsweringController` built.
        course: What the joints do.
        filter: Which states are believed, and what was counted of the others.
    """

    def __init__(
        self,
        acting: Acting,
        endpoint: Endpoint,
        *,
        operator: Operator,
        supervision: Supervision,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """
        Args:
            acting: What answers.
            endpoint: Where states are heard, and commands sent.
            operator: What the robot is asked to do.
            supervision: When joints are damped.
            clock: Time (s).

        Raises:
            InputError: if parts of what answers do not suit each other, or the robot's file does
                not say how its feet's forces are read.
        """
        robot = acting.robot
        foot_force_of(robot)
        if acting.has_day:
            robot.check_lowered(CROUCH, "the crouch in which a day begins")
        self.diagram = MakeAnsweringController(acting)
        self.course, self.filter = initial_course(robot), StateFilter()
        self._answering = _ready(Answering(self.diagram))
        self._robot, self._gains = robot, acting.joint_law.gains_of(robot)
        self._lies, self._mode = acting.has_day, NO_MODE
        self._changes = len(acting.gaits) > 1
        self._endpoint, self._operator, self._clock = endpoint, operator, clock
        self._settings = supervision
        self._gathered, self._targets = Gathered.begin(), robot.default_stance
        # Until a day has answered, its robot is taken to lie.
        self._damped = self._lies
        self._recording = (
            Recording(_predicted(robot, self._gains)) if supervision.self_test else None
        )
        self._first: int | None = None
        self._due, self._reported = 0, Stage.WAITING
        self._heard: list[Record] = []
        self._held = Button(0)
        self._heard_at = self._sent_at = -np.inf
        self._lateness = _Lateness()
        self._n_sent = 0

    @property
    def n_foreign(self) -> int:
        """Number of messages that are no LowState."""
        return self.filter.counts.foreign

    def listen(self, seconds: float) -> None:
        """Hears states, for no longer than one takes to come: a silent robot is damped."""
        for heard in self._endpoint.take(min(seconds, PERIOD)):
            state = self.filter.believed(heard)
            if state is not None:
                self._heard.append(state)
                self._lateness.note(heard.age)

    def answer(self) -> bool:
        """Commands the motors, and returns whether the controller was asked for new targets."""
        states, self._heard = self._heard, []
        now = self._clock()
        if states:
            self._heard_at = now
        # What was late is damped before it is made up for, which takes time.
        self._watch(now)
        asked = False
        for state in states:
            asked |= self._take(state)
        if self.course.stage is not Stage.WAITING:
            self._send()
        return asked

    def news(self) -> str | None:
        """Returns a sentence to report where the stage has changed."""
        if self.course.stage is self._reported:
            return None
        self._reported = self.course.stage
        return {
            Stage.WAITING: None,
            Stage.RISING: f"the robot rises, within {self._settings.rising:g} s",
            Stage.TESTING: "the robot moves each joint, to test its wiring",
            Stage.LOWERING: f"the robot is lowered, within {self._settings.rising:g} s",
            Stage.FOLLOWING: "the robot follows the controller",
            Stage.DAMPED: "; ".join(
                [f"joints are damped for good: {self.course.fault}", *self.findings]
            ),
        }[self._reported]

    @property
    def findings(self) -> list[str]:
        """What the self-test has found to be wrong."""
        return [] if self._recording is None else self._recording.findings

    def leave(self) -> None:
        """Damps the robot for half a second."""
        if self.course.stage is Stage.WAITING:
            return
        self._damp(Fault.ENDED)
        end = self._clock() + LEAVING
        while self._clock() < end:
            self.listen(PERIOD)
            self.answer()

    def counts(self) -> dict[str, float]:
        """Returns what was counted of messages, by name."""
        return {
            **self.filter.counts.rows("states", timed=True),
            "messages of another kind": self.n_foreign,
            "states later than a control period": self._lateness.n_late,
            "greatest lateness (ms)": 1e3 * self._lateness.greatest,
            "commands sent": self._n_sent,
        }

    def _take(self, state: Record) -> bool:
        """Takes a state in, and asks the controller if it is due."""
        tick, robot = int(state["tick"]), self._robot
        self._gathered = self._gathered.after(robot, state)
        followed = self.course.stage is Stage.FOLLOWING
        self.course = step_course(
            self.course,
            self._settings,
            1e-3 * tick,
            position=joints_of(robot, state)[: quadruped.N_JOINTS],
            lean=float(kinematics.lean(state["imu_state"]["quaternion"].astype(float))),
            asked=read_remote(state["wireless_remote"].tobytes()).asks_to_damp,
            lies=self._lies,
        )
        if self._first is None:
            self._first = self._due = tick
        if tick < self._due or self.course.stage is Stage.DAMPED:
            return False
        sequence = (tick - self._first) // CONTROL_TICKS
        self._due = self._first + (sequence + 1) * CONTROL_TICKS
        self._ask(state, sequence, followed=followed)
        return True

    def _ask(self, state: Record, sequence: int, *, followed: bool) -> None:
        """Asks the controller for targets."""
        remote = read_remote(state["wireless_remote"].tobytes())
        # Where there is a day, the operator drops what is pressed too early, and says so.
        remote = remote if self._lies else self._since_followed(remote, followed=followed)
        asked = self._operator(remote, self._mode if followed else NO_MODE)
        if self._changes:
            self._answering.request_gait(asked.requested_gait)
        if asked.damped:
            self._damp(Fault.ASKED)
        command = pack_command(1, sequence * CONTROL_PERIOD, asked.command, asked.requested_mode)
        sensors = sensors_of(self._robot, state, self._gathered, sequence, followed=followed)
        self._gathered = self._gathered.at_control_instant()
        if self.course.stage is Stage.TESTING:
            self._test(sensors)
        self._answering.take(sensors, command)
        answer = self.diagram.GetOutputPort("targets").Eval(self._answering.simulator.get_context())
        _, _, self._targets, self._damped = unpack_answer(answer)
        self._mode = answer.mode

    def _since_followed(self, remote: Remote, *, followed: bool) -> Remote:
        """Returns what is done with the remote since the robot follows: what was pressed before is
        not to be remembered for then, nor to count while it is held on."""
        if not followed:
            self._held = remote.buttons
            return FREE
        self._held &= remote.buttons
        return remote._replace(buttons=remote.buttons & ~self._held)

    def _test(self, sensors: sensors_t) -> None:
        """Notes what is measured in the self-test, and ends it."""
        assert self._recording is not None
        position, velocity = np.split(unpack_joints(sensors), 2)
        self._recording.note(position, velocity, unpack_touching(sensors), unpack_imu(sensors))
        if self.findings:
            self._damp(Fault.MISWIRED)
        elif self._recording.passed:
            self.course = self.course.passed(self._robot_time, lies=self._lies)

    def _watch(self, now: float) -> None:
        """Damps the joints if states or commands of its own have not come for too long."""
        limits = self._settings
        if self.course.stage is Stage.WAITING:
            return
        if now - self._heard_at > limits.silence:
            self._damp(Fault.SILENT)
        elif self._n_sent and now - self._sent_at > limits.silence:
            self._damp(Fault.LATE)
        if self.filter.bad >= limits.bad_states:
            self._damp(Fault.BAD_STATES)

    def _send(self) -> None:
        try:
            message = pack_low_cmd(self._robot, self._motor_command())
        except ValueError:
            self._damp(Fault.BAD_TARGETS)
            message = pack_low_cmd(self._robot, self._motor_command())
        self._endpoint.send(message)
        self._sent_at, self._n_sent = self._clock(), self._n_sent + 1

    def _motor_command(self) -> MotorCommand:
        return commanded(
            self._robot,
            self.course,
            self._settings,
            self._robot_time,
            targets=self._targets,
            gains=self._gains,
            damped=self._damped,
        )

    def _damp(self, fault: Fault) -> None:
        self.course = self.course.damped(fault, self._robot_time)

    @property
    def _robot_time(self) -> float:
        """Time of the latest state, by the robot's clock (s)."""
        return 1e-3 * (self._gathered.tick or 0)


def _predicted(robot: Robot, gains: tuple[float, float]) -> Prediction:
    """Returns what the self-test is to measure, by the engine that moves many robots at once."""
    stiffness, damping = gains
    station = StationConfig(engine="mujoco", time_step=PERIOD, stiffness=stiffness, damping=damping)
    return predict_self_test(robot, station)


def _ready(answering: Answering) -> Answering:
    """Has a controller answer once before a robot waits: its first answer takes longest."""
    answering.take(sensors_t(), command_t())
    answering.diagram.GetOutputPort("targets").Eval(answering.simulator.get_context())
    return answering


class _Lateness:
    """By how much older states are when they are heard than the youngest one was.

    Attributes:
        n_late: States that were older by more than a control period.
        greatest: The greatest difference (s).
    """

    def __init__(self) -> None:
        self.n_late, self.greatest = 0, 0.0
        self._least = np.inf

    def note(self, age: float) -> None:
        """Notes the age of a state (s)."""
        self._least = min(self._least, age)
        late = age - self._least
        self.greatest = max(self.greatest, late)
        self.n_late += late > CONTROL_PERIOD
