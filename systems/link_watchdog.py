"""Watches over the link between a robot and its controller."""

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    BasicVector,
    Context,
    InputPort,
    LeafSystem,
    OutputPort,
    State,
)

from glassgait.models.link.messages import targets_t
from glassgait.models.link.packing import unpack_answer
from glassgait.models.link.watchdog import Watch, Watchdog, initial_watch, step_watch
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task.day import Day
from glassgait.models.task.request import NO_MODE

N_SCALARS = 5
"""Numbers of a watch that are no joint targets."""


class LinkWatchdog(LeafSystem):
    """Passes a controller's targets on while they are young, and lowers the robot without them.

    .. pydrake_system::

        name: LinkWatchdog
        input_ports:
        - message
        - state
        output_ports:
        - targets
        - phase
        - followed
        - mode

    Inputs: message (targets_t), the latest that came; one of another session is ignored. state
    (37), the plant's, of which the trunk's attitude is read, as a robot's IMU measures it, and the
    joints' positions, to which they are sent where they are to be damped.
    Outputs: targets (12, rad), FL FR RL RR, hip thigh calf. phase (1), a number of `Phase`.
    followed (1, {0, 1}), whether joints do what the controller answers. mode (1), number of the
    mode that the controller's day is in, of the latest message; -1 where it is not followed, or
    its day is another one than the robot's.
    State: the watch (41 numbers), taken on at every step of the plant (unrestricted update), before
    the plant's discrete update of the same instant. Feedthrough: message to mode.
    """

    def __init__(
        self,
        robot: Robot,
        settings: Watchdog,
        *,
        session: int,
        time_step: float,
        day: Day | None = None,
    ) -> None:
        """
        Args:
            robot: The robot.
            settings: How long to wait.
            session: The session whose sensors are to be answered.
            time_step: The plant's period (s).
            day: The day that the robot is to live through: it lies, damped, until a controller
                answers. It stands by default.

        Raises:
            ValueError: if the time step is not positive.
        """
        super().__init__()
        if not time_step > 0.0:
            raise ValueError(f"link watchdog: time_step is {time_step}; it must be above 0")
        self._robot, self._settings, self._session = robot, settings, session
        self._initial = initial_watch(robot, lies=day is not None)
        self._day = "" if day is None else day.digest()
        self._watch = self.DeclareDiscreteState(pack_watch(self._initial))
        self._message_port = self.DeclareAbstractInputPort(
            "message", AbstractValue.Make(targets_t())
        )
        self._state_port = self.DeclareVectorInputPort(
            name="state", size=quadruped.N_POSITIONS + quadruped.N_VELOCITIES
        )
        of_state = {self.xd_ticket()}
        self._targets_port = self.DeclareVectorOutputPort(
            name="targets",
            size=quadruped.N_JOINTS,
            calc=self._calc_targets,
            prerequisites_of_calc=of_state,
        )
        self._phase_port = self.DeclareVectorOutputPort(
            name="phase", size=1, calc=self._calc_phase, prerequisites_of_calc=of_state
        )
        self._followed_port = self.DeclareVectorOutputPort(
            name="followed", size=1, calc=self._calc_followed, prerequisites_of_calc=of_state
        )
        self._mode_port = self.DeclareVectorOutputPort(
            name="mode",
            size=1,
            calc=self._calc_mode,
            prerequisites_of_calc={self.xd_ticket(), self._message_port.ticket()},
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period_sec=time_step, offset_sec=0.0, update=self._latch
        )

    def get_message_input_port(self) -> InputPort:
        """Takes the controller's latest message."""
        return self._message_port

    def get_state_input_port(self) -> InputPort:
        """Takes the plant's state."""
        return self._state_port

    def get_targets_output_port(self) -> OutputPort:
        """Gives the joint targets."""
        return self._targets_port

    def get_phase_output_port(self) -> OutputPort:
        """Gives what the joints do."""
        return self._phase_port

    def get_followed_output_port(self) -> OutputPort:
        """Gives whether the controller is followed."""
        return self._followed_port

    def get_mode_output_port(self) -> OutputPort:
        """Gives the mode that the controller's day is in."""
        return self._mode_port

    def restart(self, context: Context) -> None:
        """Forgets all answers in a context of its own: the robot was put back on its feet."""
        context.SetDiscreteState(pack_watch(self._initial))

    def _stored(self, context: Context) -> Watch:
        return unpack_watch(context.get_discrete_state(self._watch).value())

    def _calc_targets(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._stored(context).targets)

    def _calc_phase(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([float(self._stored(context).phase)])

    def _calc_followed(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([float(self._stored(context).followed)])

    def _calc_mode(self, context: Context, output: BasicVector) -> None:
        message = self._message_port.Eval(context)
        assert isinstance(message, targets_t)
        followed = self._stored(context).followed and message.session == self._session
        known = followed and message.day == self._day
        output.SetFromVector([float(message.mode if known else NO_MODE)])

    def _latch(self, context: Context, state: State) -> None:
        answer = unpack_answer(self._message_port.Eval(context))
        heard = answer if answer.session == self._session else None
        plant = self._state_port.Eval(context)
        watch = step_watch(
            self._robot,
            self._stored(context),
            heard,
            context.get_time(),
            self._settings,
            position=plant[quadruped.JOINT_POSITION],
            lean=float(kinematics.lean(plant[quadruped.QUATERNION])),
        )
        state.get_mutable_discrete_state(self._watch).SetFromVector(pack_watch(watch))


def pack_watch(watch: Watch) -> np.ndarray:
    """Returns a watch as numbers (41)."""
    scalars, targets = watch[:N_SCALARS], watch[N_SCALARS:]
    return np.concatenate([np.array(scalars, dtype=float), *targets])


def unpack_watch(numbers: np.ndarray) -> Watch:
    """Returns the watch that numbers (41) stand for."""
    phase, since, answered, unsteady, damped = numbers[:N_SCALARS].tolist()
    targets = numbers[N_SCALARS:].reshape(-1, quadruped.N_JOINTS)
    return Watch(int(phase), since, answered, unsteady, bool(damped), *targets)
