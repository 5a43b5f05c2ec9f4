"""Gates: functions of the observations that tell a formula where in the gait the robot is.

They are the states of the reward machine, whether it is early or late in a state, and which feet
are in the air. All are bounded; a product with the iterations themselves would grow without bound
where the robot is late.
"""

from glassgait.models.a1 import robot
from glassgait.models.policies.expression import Expression, constant, scaled, variable
from glassgait.models.task.observation import ITERATIONS_SCALE, machine_state_entries

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
    lifted = {
        f"Lifted {leg}": gate for leg, gate in zip(robot.LEGS, foot_gates(names), strict=True)
    }
    return {"Late": lateness_gate(names), **lifted}


def _machine_gates(names: tuple[str, ...]) -> tuple[Expression, ...]:
    """Returns the states of the machine but the last, which is where all others are 0."""
    states = machine_state_entries(names)
    return tuple(variable(index) for index in range(states.start, states.stop - 1))


def lateness_gate(names: tuple[str, ...]) -> Expression:
    """Returns a function that goes from -1 early in a state of the machine to 1 late in it.

    It is tanh((n - 4) / 2) of the n control steps spent there. A steeper and earlier one,
    tanh(n - 2), imitates better and walks no better.
    """
    return _turning(variable(names.index("RM Iters")), LATE * ITERATIONS_SCALE, 5.0)


def foot_gates(names: tuple[str, ...]) -> tuple[Expression, ...]:
    """Returns for each foot a function that goes from -1 on the ground to 1 in the air."""
    feet = [names.index(f"Foot Height {leg}") for leg in robot.LEGS]
    return tuple(_turning(variable(foot), LIFTED, 100.0) for foot in feet)


def _turning(expression: Expression, where: float, slope: float) -> Expression:
    inner = Expression("add", (scaled(expression, slope), constant(-slope * where)))
    return Expression("tanh", (inner,))
