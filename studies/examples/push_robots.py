"""Pushes many robots in one episode, and records how far they lean.

    python -m glassgait.studies.examples.push_robots

The trot of few formulas walks straight; after 3 s each robot is pushed to its left, and walks on
for 2 s. It prints how many fall, and how far the others lean, by the speed that a push adds.
"""

import numpy as np

from glassgait.diagrams import FixedCommand, Scenario
from glassgait.models import load_gait, load_student
from glassgait.models.robots import kinematics, quadruped
from glassgait.studies.common.episode import ControlStep, Observer, episode, push

N_ROBOTS, PUSHED_AT, N_STEPS = 8, 150, 250  # robots a speed, control steps
SPEEDS = (0.0, 0.5, 1.0, 1.5, 2.0)  # m/s


class GreatestLean(Observer):
    """Records how far each trunk leans at most."""

    def __init__(self) -> None:
        self.degrees: np.ndarray | float = 0.0

    def observe(self, step: ControlStep) -> None:
        lean = kinematics.lean(step.after.plant[:, quadruped.QUATERNION])
        self.degrees = np.maximum(self.degrees, lean)


def main() -> None:
    """Pushes the robots."""
    # Each robot is pushed by its speed, along its heading's left.
    speed, lean = np.repeat(SPEEDS, N_ROBOTS), GreatestLean()
    to_the_left = speed[:, None] * [0.0, 1.0, 0.0]
    ended = episode(
        load_gait("trot"),
        load_student("trot", "formulas"),
        Scenario(command=FixedCommand(speed=0.5)),
        n_robots=len(speed),
        n_steps=N_STEPS,
        seed=0,
        observers=[lean],
        events=[push(PUSHED_AT, to_the_left)],
    )
    up = ended.fell == N_STEPS
    for own in SPEEDS:
        mine = speed == own
        degrees = np.max(lean.degrees, where=mine & up, initial=0.0)
        print(f"{own} m/s: {np.sum(mine & ~up)} of {N_ROBOTS} fall, {degrees:.1f} degrees of lean")


if __name__ == "__main__":
    main()
