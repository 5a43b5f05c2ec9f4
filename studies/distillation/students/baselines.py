"""Baselines: linear laws, the open loop, and oscillators without sensors."""

import math

import numpy as np
from sklearn.linear_model import Ridge

from glassgait.models.formulas.expression import Expression, canonical, constant, variable
from glassgait.models.formulas.quantities import Definition, RobotUnits, Vocabulary
from glassgait.models.formulas.tape import Tape
from glassgait.models.policies.linear import LinearPolicy, StatewiseLinearPolicy
from glassgait.models.policies.open_loop import OpenLoopPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import SymbolicPolicy
from glassgait.models.robots import quadruped
from glassgait.models.task.observation import ITERATIONS_SCALE, indices_of, machine_state_entries
from glassgait.studies.distillation.students.gated_sum import gated_expression
from glassgait.studies.distillation.students.student import Student, StudentSettings, TrainingSet
from glassgait.studies.distillation.students.symbolic import readable

RIDGE = 1.0
"""Weight of the penalty on the squared weights."""


def untrained_student(expert: Policy) -> Policy:
    """Returns the student before its first fit: it asks for the default stance."""
    names, n_joints = expert.observation_names, quadruped.N_JOINTS
    weights, intercepts = np.zeros((n_joints, len(names))), np.zeros(n_joints)
    return LinearPolicy(expert.gait, names, weights, intercepts, robot=expert.robot)


def _fit_linear(
    samples: TrainingSet, settings: StudentSettings, *, seed: int, n_jobs: int
) -> LinearPolicy:
    model = Ridge(RIDGE).fit(samples.observations, samples.actions)
    names = samples.observation_names
    return LinearPolicy(samples.gait, names, model.coef_, model.intercept_, robot=samples.robot)


def _fit_statewise_linear(
    samples: TrainingSet, settings: StudentSettings, *, seed: int, n_jobs: int
) -> StatewiseLinearPolicy:
    models = [
        Ridge(RIDGE).fit(samples.observations[mine], samples.actions[mine])
        for mine in samples.by_state()
    ]
    weights = np.array([model.coef_ for model in models])
    intercepts = np.array([model.intercept_ for model in models])
    names = samples.observation_names
    return StatewiseLinearPolicy(samples.gait, names, weights, intercepts, robot=samples.robot)


LINEAR = Student("linear", "Linear", _fit_linear, color="#8A8A8A", marker="v", brevity=6)

STATEWISE_LINEAR = Student(
    "statewise_linear",
    "Linear per RM state",
    _fit_statewise_linear,
    color="#666666",
    marker="^",
    brevity=4,
)


ITERATIONS = 16
"""Moments of a machine's state that are distinguished; commands ask for 6 to 11."""


def _fit_open_loop(
    samples: TrainingSet, settings: StudentSettings, *, seed: int, n_jobs: int
) -> OpenLoopPolicy:
    names, observations = samples.observation_names, samples.observations
    actions = samples.actions
    one_hot = observations[:, machine_state_entries(names)]
    state, n_states = np.argmax(one_hot, axis=1), one_hot.shape[1]
    (iterations,) = indices_of("iterations", names)
    counted = np.rint(observations[:, iterations] / ITERATIONS_SCALE).astype(int)
    iteration = np.minimum(counted, ITERATIONS - 1)
    table = np.tile(actions.mean(axis=0), (n_states, ITERATIONS, 1))
    for s in range(n_states):
        for i in range(ITERATIONS):
            mine = (state == s) & (iteration == i)
            # A moment that was never visited goes on with the one before it.
            table[s, i] = actions[mine].mean(axis=0) if mine.any() else table[s, max(0, i - 1)]
    return OpenLoopPolicy(samples.gait, names, table=table, robot=samples.robot)


OPEN_LOOP = Student("open_loop", "Open loop", _fit_open_loop, color="#949494", marker="x")


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
    "oscillator", "Oscillators", _fit_oscillator, color="#777777", marker="1", brevity=7
)
"""An honest baseline: 36 numbers, and no sensor but the feet that turn the machine on.

After Raffin et al., «An open-loop baseline for reinforcement learning locomotion tasks», 2023,
whose oscillators have about 17 numbers; `glassgait refine` tunes these in closed loop.
"""
