"""Gates: functions of the observations that tell a formula where in the gait the robot is.

They are the states of the reward machine, whether it is early or late in a state, and which feet
are in the air. All are bounded; a product with the iterations themselves would grow without bound
where the robot is late.
"""

from glassgait.models.policies.expression import Expression, constant, scaled, variable
from glassgait.models.task.observation import ITERATIONS_SCALE, entries_of, indices_of

LATE = 4
"""Control steps in a state of the machine that are neither early nor late."""

LIFTED = 0.02
"""Height of a foot that is neither on the ground nor in the air (m)."""

GATE_MEANINGS = {
    "Late": "−1 as a state of the machine begins, 0 after four control steps, 1 late in it",
    "Lifted": "−1 on the ground, 0 at 2 cm, 1 in the air",
}
"""What the values of a gate mean, by the start of its name."""


def symbolic_gates(names: tuple[str, ...]) -> tuple[Expression, ...]:
    """Returns the gates of formulas that serve every state of the machine."""
    states = _machine_gates(names)
    late, *lifted = statewise_symbolic_gates(names)
    products = (Expression("mul", (state, late)) for state in states)
    return (*states, late, *products, *lifted)


def statewise_symbolic_gates(names: tuple[str, ...]) -> tuple[Expression, ...]:
    """Returns the gates of formulas that serve one state of the machine."""
    return tuple(named_gates(names).values())


def named_gates(names: tuple[str, ...]) -> dict[str, Expression]:
    """Returns the gates that formulas are written with: lateness, and whether each foot is up."""
    (iterations,) = indices_of("iterations", names)
    lifted = {
        f"Lifted {entry.leg}": _lifted(index)
        for index, entry in enumerate(entries_of(names))
        if entry.group == "foot height"
    }
    return {"Late": _late(iterations), **lifted}


def _machine_gates(names: tuple[str, ...]) -> tuple[Expression, ...]:
    """Returns the states of the machine but the last, which is where all others are 0."""
    return tuple(variable(index) for index in indices_of("machine state", names)[:-1])


def _late(iterations: int) -> Expression:
    """Returns a function that goes from -1 early in a state of the machine to 1 late in it.

    It is tanh((n - 4) / 2) of the n control steps spent there. A steeper and earlier one,
    tanh(n - 2), imitates better and walks no better.
    """
    return _turning(variable(iterations), LATE * ITERATIONS_SCALE, 5.0)


def _lifted(foot_height: int) -> Expression:
    """Returns a function that goes from -1 on the ground to 1 in the air."""
    return _turning(variable(foot_height), LIFTED, 100.0)


def _turning(expression: Expression, where: float, slope: float) -> Expression:
    inner = Expression("add", (scaled(expression, slope), constant(-slope * where)))
    return Expression("tanh", (inner,))
