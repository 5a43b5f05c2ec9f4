"""The self-test of a robot's wiring: what every joint and sensor answers while the robot stands.

Before a controller acts, the robot stands for two seconds. One leg after the other lifts its foot
twice, to move its hip outward and its thigh, and then pushes the ground with its thigh, which turns
the trunk. What is measured is compared with what a simulation of the same robot predicts. Joints in
another order, signs and units that are others', and sensors that are mixed up answer otherwise.
"""

from collections.abc import Iterator, Sequence
from functools import cache
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.robots.quadruped import JOINTS, LEG_JOINTS, LEGS, N_JOINTS, N_LEGS
from glassgait.models.robots.robot import Robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.imu import ImuReading

REST_STEPS = 4
"""Control steps before the first lift, in which nothing moves."""

MOVE_STEPS, PAUSE_STEPS = 6, 2
"""Control steps of a move, and until the next."""

FLEXION, SWING = 0.6, 0.3
"""By how much a calf flexes to lift its foot, and its hip or thigh moves meanwhile (rad)."""

MOVES = ((SWING, 0.0, FLEXION), (0.0, SWING, FLEXION), (0.0, SWING, 0.0))
"""By how much a leg's hip goes outward, its thigh moves and its calf flexes in each move (rad)."""

N_STEPS = REST_STEPS + N_LEGS * len(MOVES) * (MOVE_STEPS + PAUSE_STEPS)
"""Control steps of the self-test: two seconds."""

LATEST = 2
"""Greatest delay of what is measured (control steps)."""

FROZEN = 4
"""Control steps in a row without any change in which sensors count as frozen."""

BETTER = 0.018
"""By how much another wiring must fit better than the right one to be reported."""

TURNS = 6
"""Number of an IMU's readings that are compared: how the trunk turns, and is pushed."""

PAIRS = tuple(
    (3 * first + part, 3 * second + part)
    for part in range(len(LEG_JOINTS))
    for first, second in combinations(range(N_LEGS), 2)
)
"""Joints of one kind, pair by pair: others differ by their angles at rest."""


class Trace(NamedTuple):
    """What is measured at the end of each control step.

    Attributes:
        joint_position: Joint positions (n, 12; rad).
        joint_velocity: Joint velocities (n, 12; rad/s).
        touching: Whether each foot presses on the ground (n, 4).
        imu: The IMU's readings (n, 9).
    """

    joint_position: Array
    joint_velocity: Array
    touching: NDArray[np.bool_]
    imu: Array


class Prediction(NamedTuple):
    """What a simulated robot measures.

    Attributes:
        expected: Of a robot that is wired as it should be.
        exchanged: Of one whose joints of a pair get each other's targets, of each of `PAIRS`.
    """

    expected: Trace
    exchanged: Sequence[Trace]


def exchange(pair: tuple[int, int]) -> NDArray[np.int64]:
    """Returns the order (12) of joints of which a pair is exchanged."""
    order = np.arange(N_JOINTS)
    order[list(pair)] = order[list(pair[::-1])]
    return order


@cache
def self_test_targets(robot: Robot) -> Array:
    """Returns the joint targets (n, 12; rad) of the self-test, within the joints' ranges."""
    targets = np.tile(robot.default_stance, (N_STEPS, 1))
    bump = np.sin(np.pi * (np.arange(MOVE_STEPS) + 1.0) / (MOVE_STEPS + 1.0)) ** 2
    begin = REST_STEPS
    for leg in range(N_LEGS):
        own = slice(3 * leg, 3 * leg + 3)
        # A knee that points backward flexes to smaller angles.
        folds = np.sign(robot.default_stance[own][2]) or -1.0
        for move in MOVES:
            reach = np.array([robot.side[leg], 1.0, folds]) * move
            targets[begin : begin + MOVE_STEPS, own] += bump[:, None] * reach
            begin += MOVE_STEPS + PAUSE_STEPS
    targets = np.clip(targets, robot.lower_limits, robot.upper_limits)
    targets.flags.writeable = False
    return targets


class Recording:
    """What is measured while the self-test goes on, and what it shows.

    Attributes:
        findings: What is wrong so far; nothing more is found once something is.
    """

    def __init__(self, prediction: Prediction) -> None:
        self._prediction = prediction
        self._rows: list[tuple[Array, Array, NDArray[np.bool_], Array]] = []
        self.findings: list[str] = []

    def note(
        self, position: Array, velocity: Array, touching: NDArray[np.bool_], imu: Array
    ) -> None:
        """Notes what is measured at a control instant, the first one at the beginning."""
        self._rows.append((position, velocity, touching, imu))
        # What is measured at the beginning is none of its moves'.
        n_steps = len(self._rows) - 1
        if self.findings or n_steps not in (REST_STEPS, N_STEPS):
            return
        parts = zip(*self._rows[1:], strict=True)
        position, velocity, touching, imu = (np.array(part) for part in parts)
        trace = Trace(position, velocity, touching, imu)
        if n_steps == REST_STEPS:
            self.findings = rest_findings(self._prediction.expected, trace)
        else:
            self.findings = motion_findings(self._prediction, trace)

    @property
    def passed(self) -> bool:
        """Whether the self-test is over, and nothing was found."""
        return len(self._rows) > N_STEPS and not self.findings


class Bounds(NamedTuple):
    """How far a measured signal may be from what it is compared with.

    Attributes:
        offset: Greatest difference of the mean at rest.
        slope: Least and greatest slope of its regression on the predicted signal: 1 for the same,
            -1 for the contrary sign, 0 for another signal.
    """

    offset: float
    slope: tuple[float, float]


BOUNDS = {
    "position": Bounds(0.2, (0.3, 2.0)),
    "velocity": Bounds(1.6, (0.4, 1.7)),
    "angular velocity": Bounds(0.25, (0.4, 2.0)),
    "velocity change": Bounds(0.05, (0.3, 2.0)),
    "gravity": Bounds(0.2, (0.4, 2.0)),
}
"""Of each kind of signal. Robots with loads up to 2 kg, motors of 80 to 120 % and frictions of 0.4
to 1.25 stay within, in both engines; with 5 kg beside the trunk's middle 3 of 60 did not."""

STILL = 0.02
"""Standard deviation below which a predicted signal is not compared in motion."""


def rest_findings(predicted: Trace, measured: Trace) -> list[str]:
    """Reports what is wrong before anything moves.

    Args:
        predicted: Of the whole self-test.
        measured: Of its first `REST_STEPS` steps, or of more.

    Returns:
        A sentence for each signal whose mean is off; none if all is well.
    """
    findings = []
    for kind, name, theirs, ours in _signals(predicted, measured):
        own, expected = np.mean(ours[:REST_STEPS]), np.mean(theirs[:REST_STEPS])
        # NaN is off as well.
        if not abs(own - expected) <= BOUNDS[kind].offset:
            findings.append(
                f"the {kind} {name} is {own:.3g} at rest, where {expected:.3g} is expected; check "
                "its order, sign and unit, and that the robot stands level in its stance"
            )
    for leg, touching in zip(LEGS, measured.touching[:REST_STEPS].T, strict=True):
        if np.mean(touching) < 0.5:
            findings.append(f"the foot {leg} reads no contact at rest; check its sensor")
    return findings


def motion_findings(prediction: Prediction, measured: Trace) -> list[str]:
    """Reports what answers the self-test otherwise than predicted.

    Joint velocities are compared with how the measured positions change, all else with what is
    predicted.

    Args:
        prediction: What is predicted.
        measured: Of the whole self-test.

    Returns:
        A sentence for each signal that does; none if all is well.
    """
    findings, predicted = [], prediction.expected
    changes = np.gradient(measured.joint_position, CONTROL_PERIOD, axis=0)
    compared = predicted._replace(joint_velocity=changes)
    for kind, name, theirs, ours in _signals(compared, measured):
        if np.std(theirs) < STILL:
            continue
        slope, (least, greatest) = _slope(theirs, ours), BOUNDS[kind].slope
        if not least <= slope <= greatest:
            findings.append(
                f"the {kind} {name} answers by {slope:.2f} times of what is expected; check its "
                "order, sign and unit"
            )
    lifts, lifted = ((~own.touching).astype(float) for own in (predicted, measured))
    return [
        *findings,
        *_mixed(JOINTS, changes, measured.joint_velocity, "velocities"),
        *_mixed(LEGS, lifts, lifted, "contact sensors"),
        *_stuck(lifted),
        *_frozen(measured),
        *_exchanged(prediction, measured),
    ]


def _stuck(lifted: Array) -> Iterator[str]:
    """Reports feet that read a contact all the time (n, 4)."""
    for leg, own in zip(LEGS, lifted.T, strict=True):
        if not own.any():
            yield f"the foot {leg} reads a contact even where it is lifted; check its sensor"


def _frozen(measured: Trace) -> Iterator[str]:
    """Reports readings that stay the same to the last bit while joints move."""
    for what, values in (("joints", measured.joint_position), ("IMU", measured.imu)):
        same = np.all(np.diff(values[REST_STEPS:], axis=0) == 0.0, axis=1)
        runs = np.convolve(same, np.ones(FROZEN), mode="valid")
        if (runs >= FROZEN).any():
            yield f"the {what} read the same for {FROZEN + 1} steps; check that new states come"


def _exchanged(prediction: Prediction, measured: Trace) -> Iterator[str]:
    """Reports pairs of joints whose exchange explains what is measured better than its absence.

    Two joints that are exchanged in targets and sensors alike answer as they should: that the trunk
    turns otherwise gives them away.
    """

    def score(position: Array, imu: Array) -> float:
        joints, _ = _fit(position, measured.joint_position)
        trunk, _ = _fit(imu[:, :TURNS], measured.imu[:, :TURNS])
        return float(np.mean(joints) + np.mean(trunk)) / 2.0

    expected = prediction.expected
    usual = score(expected.joint_position, expected.imu) + BETTER
    for pair, moved in zip(PAIRS, prediction.exchanged, strict=True):
        order, (first, second) = exchange(pair), (JOINTS[joint] for joint in pair)
        for what, position, imu in (
            ("targets", moved.joint_position, moved.imu),
            ("positions", expected.joint_position[:, order], expected.imu),
            ("targets and sensors", moved.joint_position[:, order], moved.imu),
        ):
            if score(position, imu) > usual:
                yield f"the {what} of {first} and {second} are exchanged; check the joints' order"


def _mixed(names: Sequence[str], predicted: Array, measured: Array, what: str) -> Iterator[str]:
    """Reports pairs of signals (n, m) that fit each other's prediction better than their own."""
    fit, _ = _fit(predicted[:, :, None], measured[:, None])
    pairs = range(len(names))
    for i, j in combinations(pairs, 2):
        if fit[i, i] + fit[j, j] <= fit[i, j] + fit[j, i]:
            yield f"the {what} of {names[i]} and {names[j]} are in each other's place"


def _signals(predicted: Trace, measured: Trace) -> Iterator[tuple[str, str, Array, Array]]:
    """Yields kind, name, prediction (n,) and measurement (m,) of every signal."""
    pairs = (
        ("position", predicted.joint_position, measured.joint_position),
        ("velocity", predicted.joint_velocity, measured.joint_velocity),
    )
    for kind, theirs, ours in pairs:
        for joint, name in enumerate(JOINTS):
            yield kind, f"of {name}", theirs[:, joint], ours[:, joint]
    kinds = ("angular velocity", "velocity change", "gravity")
    readings = ImuReading.of(predicted.imu), ImuReading.of(measured.imu)
    for kind, theirs, ours in zip(kinds, *readings, strict=True):
        for axis, name in enumerate("xyz"):
            yield kind, f"along {name}", theirs[:, axis], ours[:, axis]


def _slope(theirs: Array, ours: Array) -> float:
    """Returns the slope of a measured signal's regression on another, at its best delay."""
    if not np.all(np.isfinite(ours)):
        return np.nan
    return float(_fit(theirs, ours)[1])


def _fit(theirs: Array, ours: Array) -> tuple[Array, Array]:
    """Returns how signals (n, ...) fit others, at their best delay; shapes are broadcast.

    Returns:
        The greatest correlation over small delays (...), 0 with what does not move, and the slope
        of the second's regression on the first there (...).
    """
    correlations, slopes = [], []
    for delay in range(LATEST + 1):
        x, y = (own - own.mean(axis=0) for own in (theirs[: len(theirs) - delay], ours[delay:]))
        shared = (x * y).sum(axis=0)
        square_x, square_y = (np.square(own).sum(axis=0) for own in (x, y))
        moves = (square_x > 0.0) & (square_y > 0.0)
        size = np.sqrt(square_x * square_y)
        correlations.append(np.divide(shared, size, out=np.zeros_like(shared), where=moves))
        slopes.append(np.divide(shared, square_x, out=np.zeros_like(shared), where=moves))
    best = np.argmax(correlations, axis=0)[None]
    greatest, slope = (
        np.take_along_axis(np.array(own), best, 0)[0] for own in (correlations, slopes)
    )
    return greatest, slope
