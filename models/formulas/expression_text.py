"""Formulas read from text by a strict grammar, never evaluated by Python."""

import ast

from glassgait.models.errors import InputError, shown
from glassgait.models.formulas.expression import BINARY, UNARY, Expression

MAX_DEPTH = 100
"""Greatest depth of a formula: what walks through formulas, or pickles them, calls itself."""

MAX_NODES = 5000
"""Greatest number of nodes of a formula."""

LARGEST = 1e30
"""Greatest size of a number, so that products of a few stay finite."""

MAX_TEXT = 200_000
"""Greatest number of characters of a formula's text."""

_ARITY = {"constant": 0, "variable": 0} | dict.fromkeys(BINARY, 2) | dict.fromkeys(UNARY, 1)

_BINARY_NODES = {ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul", ast.Div: "div"}
_POWERS = {2: "square", 3: "cube"}


def variable_names(count: int) -> tuple[str, ...]:
    """Names the variables as the engines know them: x0, x1, …"""
    return tuple(f"x{i}" for i in range(count))


def parse_expression(text: str, names: tuple[str, ...]) -> Expression:
    """Reads a formula over the given variable names.

    Understood are numbers, names, + - * /, whole powers 2 and 3, and the functions of `UNARY`.

    Raises:
        InputError: if the text holds anything else, or more of it than a formula may.
    """
    if len(text) > MAX_TEXT:
        raise InputError(
            f"formula {shown(text)} has {len(text)} characters, more than {MAX_TEXT}; fit a "
            "shorter one"
        )
    index = {name: i for i, name in enumerate(names)}
    try:
        tree = ast.parse(text.strip().replace("^", "**"), mode="eval")
        formula = _expression(tree.body, index)
    except (SyntaxError, ValueError, OverflowError, RecursionError, MemoryError) as error:
        raise InputError(f"formula {shown(text)} cannot be read; fit it again") from error
    refuse_unfit(formula, len(names))
    return formula


def refuse_unfit(formula: Expression, n_variables: int) -> None:
    """Refuses a formula that is too large, or no formula of so many variables.

    Raises:
        InputError: if it is.
    """
    # A list of what is still to visit, since a formula may be deeper than Python's stack.
    pending, n_nodes = [(formula, 1)], 0
    while pending:
        node, depth = pending.pop()
        n_nodes += 1
        if depth > MAX_DEPTH:
            raise InputError(f"a formula is nested more than {MAX_DEPTH} deep; fit a shorter one")
        if n_nodes > MAX_NODES:
            raise InputError(f"a formula has more than {MAX_NODES} nodes; fit a shorter one")
        if len(node.operands) != _ARITY.get(node.operator):
            raise InputError(
                f"a formula applies {shown(node.operator)} to {len(node.operands)} operands; fit "
                "it again"
            )
        if node.operator == "constant" and not abs(node.value) <= LARGEST:
            raise InputError(
                f"a formula holds the number {node.value}; it must be from {-LARGEST:g} to "
                f"{LARGEST:g}, so fit it again"
            )
        if node.operator == "variable" and not 0 <= node.variable < n_variables:
            raise InputError(
                f"a formula asks for observation {node.variable} of {n_variables}; fit it again"
            )
        pending += [(operand, depth + 1) for operand in node.operands]


def _expression(node: ast.expr, index: dict[str, int]) -> Expression:
    match node:
        case ast.Constant(value=bool()):
            pass
        case ast.Constant(value=int() | float() as value):
            return Expression("constant", value=float(value))
        case ast.Name(id=name) if name in index:
            return Expression("variable", variable=index[name])
        case ast.UnaryOp(op=ast.UAdd(), operand=operand):
            return _expression(operand, index)
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            inner = _expression(operand, index)
            if inner.operator == "constant":
                return Expression("constant", value=-inner.value)
            return Expression("neg", (inner,))
        case ast.BinOp(left=left, op=ast.Pow(), right=ast.Constant(value=int() as power)) if (
            power in _POWERS
        ):
            return Expression(_POWERS[power], (_expression(left, index),))
        case ast.BinOp(left=left, op=operator, right=right) if type(operator) in _BINARY_NODES:
            operands = (_expression(left, index), _expression(right, index))
            return Expression(_BINARY_NODES[type(operator)], operands)
        case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if name in UNARY:
            return Expression(name, (_expression(argument, index),))
    raise InputError(f"{shown(ast.unparse(node))} does not belong in a formula; fit it again")
