"""The machine of a robot's day, stepped for any number of robots at once.

It stands between the policy and the limits of its targets: of each control step it says which mode
the robot is in, and what is asked of the joints. Postures are reached by a formula of time alone,

    s = t/T
    target = begin + (3*s**2 - 2*s**3)*(posture - begin)

from the targets `begin` at which the mode began, at rest at both ends.

**Damping is that of the limits** (`glassgait.models.robots.target_limits`): a joint that is sent to
where it is, is damped alone. The limits come last in any mode and have no memory: they damp as long
as the trunk leans by more than their `lean`, 60° by default, and let go once it does not. The day's
`lean` is smaller and is remembered: what it leads to is left only as the day says.

**Only a mode whose joints follow the policy lets it act**, and each time anew: until then the
gait's reward machine is held at its beginning (`restarted`). Odometry, and which contact sensors
are believed, go on in all modes. The policy's last action is what joints followed, in any mode. A
command is passed on to it only where walking is requested and the command is to go; it is 0
otherwise, so that a robot that is to stand or sit comes to a halt by its policy first.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.robots.robot import Robot
from glassgait.models.robots.target_limits import TargetLimits
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.day import DAMP, POLICY, PROPOSITIONS, REQUESTS, Day
from glassgait.models.task.formula import stance_code
from glassgait.models.task.imu import ImuReading
from glassgait.models.task.reward_machine import MachineState

IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

WALK = REQUESTS.index("walk")

LEAST_GRAVITY, GREATEST_GRAVITY = 0.5, 1.5
"""Length of gravity's direction beyond which a reading is not sound; it is 1 but for noise."""

BEYOND = 0.5
"""Angle past its range at which a joint's reading is not sound (rad)."""

LARGEST = 1e6
"""Greatest size of a sound number, in any unit here."""


class ModeState(NamedTuple):
    """What the machine remembers of each robot.

    Attributes:
        mode: Number of the mode (...).
        steps: Control steps in it (...), 0 at the step that entered it.
        idle: Control steps since the command last was to go (...).
        unsound: Control steps for which readings have not been sound (...).
        begin: Action at which the mode began (..., 12).
    """

    mode: IntArray
    steps: IntArray
    idle: IntArray
    unsound: IntArray
    begin: Array

    def packed(self) -> Array:
        """Returns all of it, of one robot, as numbers (16)."""
        return np.concatenate([np.array(self[:-1], dtype=float), self.begin])

    @classmethod
    def unpacked(cls, numbers: Array) -> "ModeState":
        """Returns the state that such numbers (16) are of."""
        counts, begin = np.split(numbers, [len(cls._fields) - 1])
        return cls(*map(np.asarray, counts.astype(np.int64)), begin=begin)


class ModeReadings(NamedTuple):
    """What the machine reads at a control step.

    Attributes:
        position: Measured joint positions (..., 12; rad).
        velocity: Measured joint velocities (..., 12; rad/s).
        imu: The IMU's reading (..., 9).
    """

    position: Array
    velocity: Array
    imu: Array


class ModeStep(NamedTuple):
    """What a control step brings.

    Attributes:
        state: What is remembered.
        action: What is asked of the joints (..., 12), before limits.
        acts: Whether that is what the policy asks for (...).
        damped: Whether joints are damped alone (...).
    """

    state: ModeState
    action: Array
    acts: BoolArray
    damped: BoolArray


def eased(share: Array) -> Array:
    """Returns how far a motion has come when a share of its time is over, at rest at both ends."""
    return share * share * (3.0 - 2.0 * share)


class ModeMachine:
    """Steps the modes of a day, batch-wise, by table look-up.

    Where readings are not sound, nothing is known but for how long: joints keep their targets, and
    the fault alone may lead to another mode.

    Attributes:
        day: The day.
        robot: The robot.
        goals: The action that each mode's joints go to (n_modes, 12); 0 where they do not.
        upright: Upward part of gravity's direction above which the trunk is leaning.
        level: Up to which it is level.
    """

    def __init__(self, day: Day, robot: Robot, limits: TargetLimits | None = None) -> None:
        """
        Args:
            day: The day.
            robot: The robot.
            limits: The limits that come after it, if there are any.

        Raises:
            InputError: if the robot's joints cannot take the day's postures.
        """
        day.check(robot, limits)
        self.day, self.robot = day, robot
        names = day.names
        self._initial = names.index(day.initial)
        kinds = [day.modes[name].joints for name in names]
        self._acts = np.array([kind == POLICY for kind in kinds])
        self._damped = np.array([kind == DAMP for kind in kinds])
        self._steps = np.array([day.steps(name) for name in names])
        goals = [day.posture(name, robot) for name in names]
        stance = robot.default_stance
        self.goals = (
            np.array([(stance if own is None else own) - stance for own in goals])
            / robot.action_scale
        )
        self._fault = names.index(day.damped)
        # All that is known without sound readings is whether there have been none for long.
        self._blind_leads = day.fault_formula.table[1 << PROPOSITIONS.names.index("blind")]
        self.upright = -round(float(np.cos(np.radians(day.lean))), 12)
        self.level = -round(float(np.cos(np.radians(day.level))), 12)

    def initial(self, shape: tuple[int, ...] = ()) -> ModeState:
        """Returns what is remembered before the first step of robots of a shape."""
        zero = np.zeros(shape, dtype=np.int64)
        begin = np.zeros((*shape, len(self.robot.default_stance)))
        return ModeState(np.full(shape, self._initial), zero, zero, zero, begin)

    def served(self, velocity: Array, requested: IntArray) -> Array:
        """Returns the command (..., 2; m/s, rad/s) that is passed on to the policy.

        Args:
            velocity: The operator's command (..., 2; m/s, rad/s).
            requested: Number of the operator's request (...).

        Raises:
            ValueError: if a request has no such number.
        """
        requested = np.asarray(requested)
        if np.any((requested < 0) | (requested >= len(REQUESTS))):
            raise ValueError(
                f"mode machine: requested is {requested.tolist()}; it must be a number from 0 to "
                f"{len(REQUESTS) - 1}"
            )
        goes = (np.abs(velocity) > [self.day.speed, self.day.yaw_rate]).any(axis=-1)
        return np.where((goes & (requested == WALK))[..., None], velocity, 0.0)

    def acted(self, state: ModeState) -> BoolArray:
        """Returns whether the policy acted at the step before (...)."""
        return self._acts[state.mode]

    def step(
        self,
        state: ModeState,
        readings: ModeReadings,
        *,
        requested: IntArray,
        served: Array,
        action: Array,
        before: Array,
    ) -> ModeStep:
        """Advances by one control step.

        Args:
            state: What is remembered.
            readings: What is read now.
            requested: Number of the operator's request (...).
            served: The command that the policy is given (..., 2), of `served`.
            action: What the policy asks for (..., 12).
            before: The action of the step before, as limits left it (..., 12).
        """
        sound = self.sound(readings)
        goes = (served != 0.0).any(axis=-1) & sound
        blind = state.unsound > round(self.day.blindness / CONTROL_PERIOD)
        code = self._code(state, readings, requested=requested, goes=goes, blind=blind)
        lost = np.where(blind & self._blind_leads, self._fault, state.mode)
        mode = np.where(sound, self.day.next_modes[state.mode, code], lost)
        changed = mode != state.mode
        steps = np.where(changed, 0, state.steps + 1)
        begin = np.where(changed[..., None], before, state.begin)
        duration = np.maximum(self._steps[mode], 1)
        share = eased(np.minimum(steps / duration, 1.0))[..., None]
        position = np.where(sound[..., None], readings.position, self.robot.default_stance)
        here = (position - self.robot.default_stance) / self.robot.action_scale
        acts, damped = self._acts[mode], self._damped[mode]
        posture = begin + share * (self.goals[mode] - begin)
        asked = np.where(acts[..., None], action, posture)
        asked = np.where(damped[..., None], here, asked)
        # Where joints are is not known then, nor may the policy know it.
        finite = np.isfinite(asked).all(axis=-1)
        asked = np.where((sound & finite)[..., None], asked, before)
        after = ModeState(
            mode=mode,
            steps=steps,
            idle=np.where(goes, 0, state.idle + 1),
            unsound=np.where(sound & finite, 0, state.unsound + 1),
            begin=begin,
        )
        return ModeStep(after, asked, acts, damped)

    def sound(self, readings: ModeReadings) -> BoolArray:
        """Returns whether readings can be meant (...)."""
        finite = (np.abs(np.concatenate(readings, axis=-1)) <= LARGEST).all(axis=-1)
        gravity = ImuReading.of(readings.imu).gravity
        square = np.square(np.clip(gravity, -LARGEST, LARGEST)).sum(axis=-1)
        down = (square >= LEAST_GRAVITY**2) & (square <= GREATEST_GRAVITY**2)
        low, high = self.robot.lower_limits - BEYOND, self.robot.upper_limits + BEYOND
        within = ((readings.position >= low) & (readings.position <= high)).all(axis=-1)
        return finite & down & within

    def _code(
        self,
        state: ModeState,
        readings: ModeReadings,
        *,
        requested: IntArray,
        goes: BoolArray,
        blind: BoolArray,
    ) -> NDArray[np.intp]:
        """Returns the code of the propositions (...), of sound readings."""
        day, imu = self.day, ImuReading.of(readings.imu)
        upward, requested = imu.gravity[..., 2], np.asarray(requested)
        turns = (np.abs(imu.angular_velocity) > day.turning).any(axis=-1)
        square = np.square(np.clip(readings.velocity, -LARGEST, LARGEST)).sum(axis=-1)
        moves = square > readings.velocity.shape[-1] * day.joint_speed**2
        holds = {
            **{name: requested == number for number, name in enumerate(REQUESTS)},
            "go": goes,
            "halted": state.idle >= round(day.halt / CONTROL_PERIOD),
            "done": state.steps >= self._steps[state.mode],
            "leaning": upward > self.upright,
            "level": upward <= self.level,
            "slow": ~turns & ~moves,
            "blind": blind,
        }
        columns = [np.broadcast_to(holds[name], goes.shape) for name in PROPOSITIONS.names]
        return stance_code(np.stack(columns, axis=-1))


def restarted(initial: MachineState, machine: MachineState, acted: BoolArray) -> MachineState:
    """Returns the states of reward machines, at their beginning where no policy acted (...).

    Args:
        initial: Where they begin.
        machine: Where they are.
        acted: Whether the policy acted at the step before (...).
    """
    return MachineState(
        *(np.where(acted, own, first) for own, first in zip(machine, initial, strict=True))
    )
