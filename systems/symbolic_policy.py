"""Formula, linear and open-loop policies in Drake's own symbols, to be differentiated."""

from collections.abc import Callable, Sequence
from functools import reduce
from typing import TypeAlias

import numpy as np
import pydrake.symbolic as drake
from pydrake.systems.primitives import SymbolicVectorSystem

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.formulas.expression import Expression
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.policies.linear import LinearPolicy, OpenLoopPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task.observation import ITERATIONS_SCALE, indices_of, machine_state_entries

Symbols: TypeAlias = Sequence[drake.Variable]

_FUNCTIONS: dict[str, Callable[..., drake.Expression]] = {
    "add": lambda left, right: left + right,
    "sub": lambda left, right: left - right,
    "mul": lambda left, right: left * right,
    "div": lambda left, right: left / right,
    "neg": lambda inner: -inner,
    "sin": drake.sin,
    "cos": drake.cos,
    "tanh": drake.tanh,
    "exp": drake.exp,
    "log": drake.log,
    "sqrt": drake.sqrt,
    "abs": drake.abs,
    "square": lambda inner: drake.pow(inner, 2),
    "cube": lambda inner: drake.pow(inner, 3),
}


def make_symbolic_policy(policy: Policy) -> SymbolicVectorSystem:
    """Writes a policy's actions as symbolic expressions of the observations.

    .. pydrake_system::

        name: SymbolicVectorSystem
        input_ports:
        - u0
        output_ports:
        - y0

    Inputs: u0 (47 + n_states), the observation, in the order of the policy's `observation_names`,
    by which its variables are called.
    Outputs: y0 (12), the action, FL FR RL RR, hip thigh calf.
    State: none. Feedthrough: yes.

    It acts as `PolicySystem` does and converts to `AutoDiffXd` and back. Drake names the ports of a
    `SymbolicVectorSystem`; `get_input_port()` and `get_output_port()` give them.

    `if_then_else` selects the machine's state, not a product with the one-hot entries. So only the
    formulas of the state that is on are evaluated (others may not even be finite there), and the
    gradient by the entries themselves is 0, the machine's state held, as in
    `FormulaPolicy.derivatives`. Where two entries are equally great, as never in a one-hot state,
    the first one counts and there is no gradient.

    Drake raises RuntimeError or ValueError where an observation or an action is not a number.

    Args:
        policy: A symbolic, a linear or an open-loop policy.

    Raises:
        InputError: if the policy is of another kind, or a formula has no value anywhere.
    """
    variables = [drake.Variable(name) for name in policy.observation_names]
    actions = _actions(policy, variables)
    system = SymbolicVectorSystem(input=np.array(variables), output=np.array(actions))
    system.set_name("symbolic_policy")
    return system


def _actions(policy: Policy, variables: Symbols) -> list[drake.Expression]:
    """Returns the expressions of the actions (12)."""
    match policy:
        case FormulaPolicy(formulas_by_state=formulas, vocabulary=vocabulary):
            expanded = ([vocabulary.expanded(formula) for formula in row] for row in formulas)
            by_state = [
                _formulas(policy.robot, row, _quantities(policy, variables)) for row in expanded
            ]
        case LinearPolicy():
            weights = zip(*policy.by_state(), strict=True)
            by_state = [_weighted(rows, intercepts, variables) for rows, intercepts in weights]
        case OpenLoopPolicy(table=table):
            (at,) = indices_of("iterations", policy.observation_names)
            iterations = variables[at]
            by_state = [[_entry(column, iterations) for column in rows.T] for rows in table]
        case _:
            raise InputError(
                f"a {policy.kind} policy has no formulas; make a symbolic system of a symbolic, a "
                "linear or an open-loop policy, or use PolicySystem"
            )
    if len(by_state) == 1:
        return by_state[0]
    states = variables[machine_state_entries(policy.observation_names)]
    return [_of_state(branches, states) for branches in zip(*by_state, strict=True)]


def _of_state(branches: Sequence[drake.Expression], states: Symbols) -> drake.Expression:
    """Takes the branch of the greatest entry, the first of equals, as `numpy.argmax` does."""
    chosen = branches[-1]
    for index in reversed(range(len(branches) - 1)):
        greatest_after = reduce(drake.max, states[index + 1 :])
        chosen = drake.if_then_else(states[index] >= greatest_after, branches[index], chosen)
    return chosen


def _weighted(weights: Array, intercepts: Array, variables: Symbols) -> list[drake.Expression]:
    return [
        sum((weight * x for weight, x in zip(row, variables, strict=True)), drake.Expression(own))
        for row, own in zip(weights, intercepts, strict=True)
    ]


def _entry(column: Array, iterations: drake.Variable, first: int = 0) -> drake.Expression:
    """Looks an action up by halving; beyond either end of the column, the end counts."""
    if len(column) == 1:
        return drake.Expression(column[0])
    half = len(column) // 2
    boundary = (first + half - 0.5) * ITERATIONS_SCALE
    return drake.if_then_else(
        iterations < boundary,
        _entry(column[:half], iterations, first),
        _entry(column[half:], iterations, first + half),
    )


def _quantities(policy: FormulaPolicy, variables: Symbols) -> list[drake.Expression]:
    """Returns what formulas read, of the observations."""
    units = RobotUnits.of(policy.robot, policy.observation_names)
    quantities = [
        x / scale + offset
        for x, scale, offset in zip(variables, units.scale, units.offset, strict=True)
    ]
    if policy.readings is None:
        return quantities
    ends = zip(*policy.readings.ends(policy.observation_names), strict=True)
    return [
        drake.min(drake.max(x, low), high) if low > -np.inf else x
        for x, (low, high) in zip(quantities, ends, strict=True)
    ]


def _formulas(
    robot: Robot, formulas: Sequence[Expression], quantities: Sequence[drake.Expression]
) -> list[drake.Expression]:
    """Returns the actions (12) whose joint targets formulas of the quantities are."""
    translated = []
    for joint, formula in zip(quadruped.JOINTS, formulas, strict=True):
        try:
            translated.append(_translated(formula, quantities))
        except (RuntimeError, ValueError) as error:
            # Drake evaluates what holds no variable at once.
            raise InputError(
                f"the formula of {joint} has no value ({error}); fit it again"
            ) from error
    return [
        (target - stance) / robot.action_scale
        for target, stance in zip(translated, robot.default_stance, strict=True)
    ]


def _translated(formula: Expression, quantities: Sequence[drake.Expression]) -> drake.Expression:
    match formula.operator:
        case "constant":
            return drake.Expression(formula.value)
        case "variable":
            return quantities[formula.variable]
        case operator:
            operands = (_translated(operand, quantities) for operand in formula.operands)
            return _FUNCTIONS[operator](*operands)
