"""A simulated robot's end of Unitree's wire, which may be a process of its own."""

from enum import IntEnum
from typing import ClassVar

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.multibody.plant import MultibodyPlant

from glassgait.diagrams.plant_state import set_plant_state
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.simulated_robot import SimulatedRobot
from glassgait.diagrams.station import actuated_joints
from glassgait.diagrams.unitree_robot import MakeUnitreeRobot, at_its_rate, set_gains
from glassgait.models.arrays import Array
from glassgait.models.link.dds import Endpoint
from glassgait.models.link.low_state import CONTROL_TICKS, PERIOD, TICKS, pack_state
from glassgait.models.link.message_filter import CommandFilter
from glassgait.models.link.motors import MotorCommand, damping
from glassgait.models.link.remote import Remote, write_remote
from glassgait.models.link.watchdog import CROUCH
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.task.imu import ImuReading

SILENCE = 0.1
"""Time without a command after which a simulated robot counts as left alone (s)."""

UNTOUCHED = write_remote(Remote.untouched())
"""The bytes of a remote that is not touched."""


class Drive(IntEnum):
    """What the motors of a simulated robot do."""

    LIMP = 0
    """They brake, until the first command."""
    DRIVEN = 1
    """They follow commands."""
    DAMPED = 2
    """They are commanded to brake."""
    ALONE = 3
    """They go on by the last command: none has come for `SILENCE`."""


class UnitreeRobotEnd(SimulatedRobot):
    """Simulates a robot that sends LowState every 2 ms and acts on the last LowCmd that came.

    It lies at its crouch at first. It is not put back on its feet when it falls, and it has no
    watchdog: what a real one does when commands stop is not known here. Its diagram is what
    `MakeUnitreeRobot` built.

    Attributes:
        filter: Which commands are believed, and what was counted of the others.
        remote: The bytes of the robot's remote (40).
    """

    reported: ClassVar = {
        (Drive.LIMP, Drive.DRIVEN): "the motors are driven",
        (Drive.DRIVEN, Drive.DAMPED): "the motors are damped",
        (Drive.DRIVEN, Drive.ALONE): "no command comes: the motors go on by the last one",
        (Drive.DAMPED, Drive.ALONE): "no command comes: the motors stay damped",
        (Drive.ALONE, Drive.DRIVEN): "commands come again",
        (Drive.DAMPED, Drive.DRIVEN): "the motors are driven again",
    }
    counted: ClassVar = {"times damped": Drive.DAMPED, "times alone": Drive.ALONE}
    held = Drive.ALONE
    slack = SILENCE

    def __init__(
        self,
        scenario: Scenario,
        endpoint: Endpoint,
        *,
        seed: int = 0,
        meshcat: Meshcat | None = None,
    ) -> None:
        """
        Raises:
            InputError: if the scenario is not made for two processes, or the robot cannot crouch.
        """
        scenario = at_its_rate(scenario)
        scenario.robot_of().check_lowered(CROUCH, "the crouch in which it begins")
        super().__init__(MakeUnitreeRobot(scenario, meshcat), scenario, seed)
        robot = scenario.robot_of()
        self.filter, self.remote = CommandFilter(robot), UNTOUCHED
        self._robot, self._endpoint = robot, endpoint
        self._plant = self.diagram.GetSubsystemByName("plant")
        assert isinstance(self._plant, MultibodyPlant)
        joints = actuated_joints(self._plant)
        self._order = np.array([quadruped.JOINTS.index(name) for name in joints])
        self._last: MotorCommand | None = None
        self._driven: MotorCommand | None = None
        self._gains: tuple[Array, Array] | None = None
        self._commanded_at, self._answered = -np.inf, -1
        self._n_sent = 0
        lying = scenario.station.ground.stand(robot, kinematics.standing_state(robot, CROUCH))
        set_plant_state(self.diagram, self.simulator.get_mutable_context(), lying)
        self._drive(damping(CROUCH, robot.damping))

    def listen(self, seconds: float) -> None:
        """Hears commands for some time (s), or until one came."""
        if self._now - self._commanded_at > SILENCE:
            self.filter.release()
        for heard in self._endpoint.take(seconds):
            command = self.filter.believed(heard)
            if command is not None:
                self._last = command
                self._commanded_at, self._answered = self._now, self.step
                self._drive(command)

    def send(self) -> None:
        """Sends the state of this control instant."""
        self._send(self.step * CONTROL_TICKS)

    def advance(self, part: int) -> None:
        """Sends the state of this instant, hears what came, and takes a step of the plant."""
        if part:
            self._send(self.step * CONTROL_TICKS + part * TICKS)
        super().advance(part)

    @property
    def answered(self) -> bool:
        """Whether a command came since the last control instant."""
        return self._answered >= self.step

    @property
    def n_foreign(self) -> int:
        """Number of messages that are no LowCmd."""
        return self.filter.counts.foreign

    @property
    def phase(self) -> Drive:
        """What the motors do."""
        if self._last is None:
            return Drive.LIMP
        if self._now - self._commanded_at > SILENCE:
            return Drive.ALONE
        return Drive.DAMPED if self._last.is_damping else Drive.DRIVEN

    def counts(self) -> dict[str, float]:
        """Returns what was counted of messages, by name."""
        return {
            "states sent": self._n_sent,
            **self.filter.counts.rows("commands", timed=False),
            "messages of another kind": self.n_foreign,
        }

    @property
    def _now(self) -> float:
        return self.simulator.get_context().get_time()

    def _drive(self, command: MotorCommand) -> None:
        """Has the plant's joints, in an order of its own, do what is commanded."""
        if command is self._driven:
            return
        self._driven = command
        context = self.simulator.get_mutable_context()
        order = self._order
        desired: Array = np.concatenate([command.q[order], command.dq[order]])
        self.diagram.GetInputPort("desired_state").FixValue(context, desired)
        self.diagram.GetInputPort("actuation").FixValue(context, command.tau[order])
        gains = command.kp, command.kd
        if self._gains is None or not np.array_equal(self._gains, gains):
            set_gains(self._plant, *gains)
            self._gains = gains

    def _send(self, tick: int) -> None:
        imu, torque = ImuReading.of(self.output("imu")), np.empty(quadruped.N_JOINTS)
        torque[self._order] = self.output("torque")
        state = pack_state(
            self._robot,
            tick,
            joints=self.output("joints"),
            torque=torque,
            quaternion=self.output("state")[quadruped.QUATERNION],
            angular_velocity=imu.angular_velocity,
            specific_force=imu.velocity_change / PERIOD,
            foot_force=self.output("foot_force"),
            remote=self.remote,
        )
        self._endpoint.send(state)
        self._n_sent += 1
