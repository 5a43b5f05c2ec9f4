"""Oscillators without sensors: each joint follows a sine of the machine's clock."""

import math

import numpy as np

from glassgait.models.formulas.expression import Expression, canonical, constant, variable
from glassgait.models.formulas.quantities import Definition, RobotUnits, Vocabulary
from glassgait.models.formulas.tape import Tape
from glassgait.models.policies.symbolic import SymbolicPolicy
from glassgait.models.robots import quadruped
from glassgait.models.task.observation import indices_of
from glassgait.studies.distillation.students.formula_fit import readable
from glassgait.studies.distillation.students.gated_sum import gated_expression
from glassgait.studies.distillation.students.student import Student, StudentSettings, TrainingSet


def _fit_oscillator(
    samples: TrainingSet, settings: StudentSettings, *, seed: int, n_jobs: int
) -> SymbolicPolicy:
    names = samples.observation_names
    waves = _waves(names)
    observed = RobotUnits.of(samples.robot, names).quantities(samples.observations)
    values = np.hstack([observed, Tape([wave.formula for wave in waves], len(names))(observed)])
    own, targets = values[:, len(names) :], samples.robot.joint_targets(samples.actions)
    solved, *_ = np.linalg.lstsq(np.hstack([np.ones((len(own), 1)), own]), targets)
    weights = np.zeros((quadruped.N_JOINTS, 1, values.shape[1]))
    weights[:, 0, len(names) :] = solved[1:].T
    sums = [gated_expression((), row, rest) for row, rest in zip(weights, solved[0], strict=True)]
    formulas = readable(sums, values, targets)
    return SymbolicPolicy(samples.gait, names, formulas, definitions=waves, robot=samples.robot)


def _waves(names: tuple[str, ...]) -> tuple[Definition, ...]:
    """Returns sine and cosine of the clock: a turn in each cycle of the machine."""
    states = indices_of("machine state", names)
    symbols = Vocabulary(names).symbols
    clock = Expression("div", (variable(symbols.index("t")), variable(symbols.index("cmd.t"))))
    for number, state in enumerate(states[1:], start=1):
        own = variable(state)
        passed = own if number == 1 else Expression("mul", (constant(float(number)), own))
        clock = Expression("add", (clock, passed))
    turn = constant(float(f"{2.0 * math.pi / len(states):.4g}"))
    angle = Expression("mul", (turn, clock))
    return (
        Definition("swing", canonical(Expression("sin", (angle,))), "sine of the machine's clock"),
        Definition("lag", canonical(Expression("cos", (angle,))), "the same, a quarter later"),
    )


OSCILLATOR = Student(
    "oscillator", "Oscillators", _fit_oscillator, color="#999999", marker="1", brevity=7
)
"""An honest baseline: 36 numbers, and no sensor but the feet that turn the machine on.

After Raffin et al., «An open-loop baseline for reinforcement learning locomotion tasks», 2023,
whose oscillators have about 17 numbers; `glassgait refine` tunes these in closed loop.
"""
