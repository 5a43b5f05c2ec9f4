"""The two ends of the link, each of which may be a process of its own.

Messages are sent and taken in by hand. One of Drake's subscribers takes whatever came last, be it
late or useless, and lets it act a plant step late; and a publisher with a period sends the sensors
of an instant as soon as they are computed, ahead of the clock on the wall.
"""

import logging
import struct
from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.lcm import DrakeLcmInterface
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram

from glassgait.diagrams import linked_controller, linked_robot
from glassgait.diagrams.acting import Acting
from glassgait.diagrams.answering import MOST_MADE_UP, Answering, AnsweringEnd, take_in
from glassgait.diagrams.linked_controller import MakeLinkedController
from glassgait.diagrams.linked_robot import MakeLinkedRobot
from glassgait.diagrams.plant_state import set_plant_state
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.simulated_robot import SimulatedRobot
from glassgait.models.link.channels import Channels, Tally
from glassgait.models.link.messages import command_t, sensors_t, targets_t
from glassgait.models.link.packing import (
    MICROSECONDS,
    NOBODY,
    control_step,
    unpack_answer,
    unpack_imu,
    unpack_joints,
)
from glassgait.models.link.watchdog import Phase, Watchdog, is_news
from glassgait.models.robots import quadruped
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.day import REQUESTS, Day, lying_state
from glassgait.models.task.gait import Gait
from glassgait.systems.link_watchdog import LinkWatchdog

_LOG = logging.getLogger(__name__)

LONGEST_SESSION = 10**9
"""Greatest number of a control step that is believed: more than half a year of walking."""

MILLISECONDS = 1e3

FOLLOWED = (Phase.FOLLOWING, Phase.HOLDING)

REPORTED = {
    (Phase.STANDING, Phase.FOLLOWING): "a controller is followed",
    (Phase.HOLDING, Phase.LOWERED): "no answer: the robot is lowered",
    (Phase.FOLLOWING, Phase.LOWERED): "no answer: the robot is lowered",
    (Phase.LOWERED, Phase.STANDING): "answers come again: the robot rises",
    (Phase.LOWERED, Phase.TIPPED): "answers come again, but the robot leans too far to rise",
    (Phase.TIPPED, Phase.STANDING): "the robot is level again, and rises",
    (Phase.STANDING, Phase.LOWERED): "the robot leans too far to stand: it is lowered",
    (Phase.LEFT, Phase.DAMPED): "a controller is followed, which damps the joints",
    (Phase.STANDING, Phase.DAMPED): "a controller is followed, which damps the joints",
    (Phase.FOLLOWING, Phase.DAMPED): "the controller damps the joints",
    (Phase.DAMPED, Phase.FOLLOWING): "the controller moves the joints",
    (Phase.DAMPED, Phase.LEFT): "no answer: the joints stay damped",
    (Phase.LEFT, Phase.STANDING): "a controller without a day answers: the robot rises",
}
"""Changes of phase that are reported."""


class ControllerEnd(AnsweringEnd):
    """Answers sensors, as they come, by joint targets.

    The caller of `answer` handles the subscriptions of its LCM before, by `listen` or itself.

    Attributes:
        tally: Counts of the sensors that came.
        diagram: What `MakeLinkedController` built.
    """

    def __init__(
        self, acting: Acting, lcm: DrakeLcmInterface, channels: Channels, *, gait: int = 0
    ) -> None:
        """
        Args:
            acting: What answers.
            lcm: Where messages go.
            channels: Names of the channels.
            gait: Number of the gait that runs, of a controller of several: commands name none.

        Raises:
            InputError: if parts of what answers do not suit each other.
        """
        self.diagram = MakeLinkedController(acting, lcm, channels)
        self.tally = Tally()
        self._lcm, self._answering = lcm, Answering(self.diagram)
        if len(acting.gaits) > 1:
            self._answering.request_gait(gait)
        self._latest: sensors_t | None = None
        self._command = command_t()
        self._listeners = (
            Listener(lcm, channels.sensors, sensors_t, self._hear),
            Listener(lcm, channels.command, command_t, self._hear_command),
        )

    @property
    def simulator(self) -> Simulator:
        """The simulator, at the instant that was answered last."""
        return self._answering.simulator

    @property
    def n_foreign(self) -> int:
        """Number of messages of another kind, or another version, that came on its channels."""
        return sum(listener.n_foreign for listener in self._listeners)

    def answer(self) -> bool:
        """Answers the latest sensors if some came since the last answer, and returns whether."""
        message = self._latest
        self._latest = None
        if message is None:
            return False
        self._answering.take(message, self._command)
        publish(self.diagram, self.simulator, linked_controller.TARGETS_PUBLISHER)
        return True

    def listen(self, seconds: float) -> None:
        """Handles the subscriptions for some time (s), or until a message came."""
        self._lcm.HandleSubscriptions(round(MILLISECONDS * seconds))

    def counts(self) -> dict[str, float]:
        """Returns what was counted of messages, by name."""
        return {
            **{f"sensors {name}": count for name, count in self.tally.rows().items()},
            "messages of another kind": self.n_foreign,
            "robots heard": self.tally.sessions,
        }

    def _hear(self, message: sensors_t) -> None:
        measured = [*unpack_joints(message), *unpack_imu(message)]
        if not _is_stamped(message) or not np.all(np.isfinite(measured)):
            return
        self.tally.count(message.session, message.sequence)
        if self._is_wanted(message):
            self._latest = message

    def _is_wanted(self, message: sensors_t) -> bool:
        """Returns whether sensors are to be answered rather than those that wait for an answer."""
        waiting, before = self._latest, self._answering.answered
        steps = self._answering.steps_since(message)
        # What came twice or was overtaken is late; what is far behind is a start anew.
        if steps is not None and -MOST_MADE_UP <= steps <= 0:
            return False
        if waiting is None:
            return True
        if message.session == waiting.session:
            return message.sequence > waiting.sequence
        # Sensors of the session that goes on wait: those of another one may be a remnant.
        return before is None or waiting.session != before.session

    def _hear_command(self, message: command_t) -> None:
        before = self._command
        if message.session != before.session or message.sequence >= before.sequence:
            self._command = message


class RobotEnd(SimulatedRobot):
    """Simulates a robot that sends what it senses and follows the targets that it is sent.

    Its session is the number of this start, not 0. Its diagram is what `MakeLinkedRobot` built.

    Attributes:
        tally: Counts of the answers that came; one is late if the next sensors had been sent.
    """

    reported = REPORTED
    counted: ClassVar = {"times lowered": Phase.LOWERED, "times kept down": Phase.TIPPED}
    held = Phase.HOLDING

    def __init__(
        self,
        gait: Gait,
        scenario: Scenario,
        lcm: DrakeLcmInterface,
        channels: Channels,
        *,
        watchdog: Watchdog,
        session: int,
        seed: int = 0,
        meshcat: Meshcat | None = None,
        day: Day | None = None,
    ) -> None:
        """
        Args:
            gait: The gait that commands are made for.
            scenario: The world.
            lcm: Where messages go.
            channels: Names of the channels.
            watchdog: How long the robot waits for its controller.
            session: Number of this start.
            seed: Seed of the sensors' noise, of the robot's pose and of drawn commands.
            meshcat: Shows the robot there.
            day: The day that it is to live through: it begins on its belly, damped, and is not put
                back on its feet.

        Raises:
            InputError: if the scenario is not made for two processes, or the gait not for it.
            ValueError: if commands come from sliders, and there is no Meshcat.
        """
        diagram = MakeLinkedRobot(
            gait,
            scenario,
            lcm,
            channels,
            watchdog=watchdog,
            session=session,
            meshcat=meshcat,
            day=day,
        )
        super().__init__(diagram, scenario, seed)
        self._lives, self._day = day is not None, None if day is None else day.digest()
        if day is not None:
            lying = lying_state(scenario.robot_of(), day, np.zeros((1, quadruped.N_JOINTS)))[0]
            set_plant_state(self.diagram, self.simulator.get_mutable_context(), lying)
        self.tally = Tally()
        self._lcm, self._session = lcm, session
        self._robot = scenario.robot_of()
        self._answered, self._taken = -1, -np.inf
        take_in(self.diagram, self.simulator, "answer", targets_t())
        self._listener = Listener(lcm, channels.targets, targets_t, self._hear)

    def send(self) -> None:
        """Sends command and sensors of this control instant."""
        for name in linked_robot.PUBLISHERS:
            publish(self.diagram, self.simulator, name)

    @property
    def answered(self) -> bool:
        """Whether the sensors of this control instant have been answered."""
        return self._answered >= self.step

    @property
    def n_foreign(self) -> int:
        """Number of messages of another kind, or another version, that came on its channel."""
        return self._listener.n_foreign

    def listen(self, seconds: float) -> None:
        """Handles the subscriptions for some time (s), or until a message came."""
        self._lcm.HandleSubscriptions(int(MILLISECONDS * seconds))

    def request_mode(self, name: str) -> None:
        """Requests a mode of a day, of a robot that has one and no buttons.

        Raises:
            ValueError: if there is no such request.
        """
        port = self.diagram.GetInputPort("requested_mode")
        port.FixValue(self.simulator.get_mutable_context(), [float(REQUESTS.index(name))])

    @property
    def phase(self) -> Phase:
        """What the joints do."""
        return Phase(int(self.output("phase")[0]))

    @property
    def fallen(self) -> bool:
        """Whether the robot shows a failure while it follows its controller."""
        if self._lives:
            return False
        return self.phase in FOLLOWED and bool(np.any(self.output("failures") > 0.5))

    def put_back(self) -> None:
        """Puts the robot back on its feet where it began; its controller will start anew."""
        context = self.simulator.get_mutable_context()
        set_plant_state(self.diagram, context)
        guard = self.diagram.GetSubsystemByName(linked_robot.WATCHDOG)
        assert isinstance(guard, LinkWatchdog)
        guard.restart(guard.GetMyMutableContextFromRoot(context))

    def counts(self) -> dict[str, float]:
        """Returns what was counted of messages, by name."""
        return {
            "sensors sent": self.step,
            **{f"answers {name}": count for name, count in self.tally.rows().items()},
            "messages of another kind": self.n_foreign,
        }

    def _hear(self, message: targets_t) -> None:
        sent = message.session == self._session and 0 <= message.sequence <= self.step
        if not sent or control_step(message.utime / MICROSECONDS) != message.sequence:
            return
        now = self.simulator.get_context().get_time()
        late = now - message.utime / MICROSECONDS > CONTROL_PERIOD + 1.0 / MICROSECONDS
        self.tally.count(message.session, message.sequence, late=late)
        answer = unpack_answer(message)
        if is_news(self._robot, answer, self._taken, now):
            take_in(self.diagram, self.simulator, "answer", message)
            self._answered, self._taken = message.sequence, answer.time
            self._compare_days(message.day)

    def _compare_days(self, day: str) -> None:
        """Logs, once, that the controller has another day than the robot."""
        if self._day is None or day in ("", self._day):
            return
        self._day = None
        _LOG.warning(
            "the controller's day is another one than the robot's, so no button's request is "
            "taken; name its file with --day here"
        )


class Listener:
    """Hears every message of a channel, and counts those that are none.

    Attributes:
        n_foreign: Number of messages of another kind, or another version, that came.
    """

    def __init__(
        self,
        lcm: DrakeLcmInterface,
        channel: str,
        kind: Any,
        hear: Callable[[Any], None],
    ) -> None:
        self._kind, self._hear = kind, hear
        self.n_foreign = 0
        self._subscription = lcm.Subscribe(channel, self._decode)

    def _decode(self, data: bytes) -> None:
        try:
            message = self._kind.decode(data)
        except (ValueError, struct.error):
            self.n_foreign += 1
            return
        self._hear(message)


def _is_stamped(message: sensors_t) -> bool:
    return message.session != NOBODY and 0 <= message.sequence <= LONGEST_SESSION


def publish(diagram: Diagram, simulator: Simulator, name: str) -> None:
    """Has a publisher send its message at once."""
    publisher = diagram.GetSubsystemByName(name)
    publisher.ForcedPublish(publisher.GetMyContextFromRoot(simulator.get_context()))
