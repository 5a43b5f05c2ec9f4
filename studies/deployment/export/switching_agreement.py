"""Steps of robots that change their gait, for the comparison of Python and C."""

import numpy as np
from numpy.typing import NDArray

from glassgait.diagrams.scenario import Scenario
from glassgait.models.policies.switched import SwitchedPolicy
from glassgait.models.robots.robot import Robot
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.studies.common.episode import BoolArray, Episode, Event, episode
from glassgait.studies.deployment.export.agreement import (
    SEQUENCE_STEPS,
    Moment,
    RecordedMoments,
    random_sequences,
)

REQUEST_STEPS = 100
"""Control steps from one request to the next of robots that are recorded (2 s)."""

RANDOM_REQUEST_STEPS = 20
"""Control steps from one request to the next where sensors are drawn at random."""


def drawn_requests(
    switch: GaitSwitch, n_robots: int, n_steps: int, every: int, seed: int
) -> NDArray[np.int64]:
    """Draws the numbers of the gaits that robots are asked for (n_steps, n_robots).

    The first gait is asked for at first, and from time to time another one than before.

    Args:
        switch: The gaits.
        n_robots: Number of robots.
        n_steps: Control steps.
        every: Control steps from one request to the next.
        seed: Seed of what is drawn.
    """
    generator = np.random.default_rng(seed)
    n_gaits, n_requests = len(switch.gaits), -(-n_steps // every)
    onward = generator.integers(1, max(n_gaits, 2), size=(n_requests, n_robots))
    onward[0] = 0
    requested = np.cumsum(onward, axis=0) % n_gaits
    return np.repeat(requested, every, axis=0)[:n_steps]


def random_switching_sequences(
    robot: Robot, switch: GaitSwitch, n_steps: int, seed: int
) -> list[list[Moment]]:
    """Draws sensors and requests at random; every other stance ends a state of one of the gaits."""
    sequences = random_sequences(robot, switch.gait, n_steps, seed)
    requested = drawn_requests(switch, len(sequences), SEQUENCE_STEPS, RANDOM_REQUEST_STEPS, seed)
    return [
        [moment._replace(requested=int(gait)) for moment, gait in zip(sequence, own, strict=False)]
        for sequence, own in zip(sequences, requested.T, strict=True)
    ]


def recorded_switching_sequences(
    switched: SwitchedPolicy, n_steps: int, seed: int
) -> list[list[Moment]]:
    """Records what robots sense that change their gait again and again, in the training world.

    Args:
        switched: The gaits, and the policies that act and observe in each, in Python.
        n_steps: Control steps of all robots together.
        seed: Seed of initial states, commands, requests and noise.
    """
    n_robots = max(1, round(n_steps / SEQUENCE_STEPS))
    own_steps = n_steps // n_robots
    requested = drawn_requests(switched.switch, n_robots, own_steps, REQUEST_STEPS, seed)
    recorded = RecordedMoments(n_robots, requested)
    episode(
        switched.switch,
        switched,
        Scenario(),
        n_robots=n_robots,
        n_steps=own_steps,
        seed=seed,
        observers=[recorded],
        events=[asking(requested)],
        when_fallen="go on",
    )
    return recorded.sequences


def asking(requested: NDArray[np.int64]) -> Event:
    """Returns the event that requests gaits in each control step (T, n).

    What is requested while a step goes on is read at its end, with what is sensed then.
    """

    def ask(running: Episode, _: BoolArray) -> None:
        running.switching.requested = requested[running.step]

    return Event(None, None, ask)
