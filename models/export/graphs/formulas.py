"""The graph of formulas: those of all joints and states, operator by operator."""

from collections.abc import Sequence

import numpy as np

from glassgait.models.export.graphs.builder import GraphBuilder
from glassgait.models.export.graphs.policies import machine_state
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.formulas.tape import Line, Tape
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped

_FUNCTIONS = {
    "div": "Div",
    "sin": "Sin",
    "cos": "Cos",
    "tanh": "Tanh",
    "exp": "Exp",
    "log": "Log",
    "sqrt": "Sqrt",
    "abs": "Abs",
}


def add_formulas(graph: GraphBuilder, policy: FormulaPolicy, observation: str) -> str:
    """Adds formulas of each joint, the same always or others in each state."""
    rows = policy.formulas_by_state
    n = len(policy.observation_names)
    tape = Tape([policy.vocabulary.expanded(one) for row in rows for one in row], n)
    units = RobotUnits.of(policy.robot, policy.observation_names)
    scaled = graph.add("Div", observation, graph.constant(units.scale))
    quantities = graph.add("Add", scaled, graph.constant(units.offset))
    if policy.readings is not None:
        low, high = policy.readings.ends(policy.observation_names)
        quantities = graph.add("Max", quantities, graph.constant(low))
        quantities = graph.add("Min", quantities, graph.constant(high))
    target = _evaluated(graph, tape, quantities)
    if len(policy.dims) == 2:
        # All states' formulas are evaluated; where they are not the state's own they may be
        # anything, and are left aside.
        table = graph.add("Reshape", target, graph.indices([-1, len(rows), quadruped.N_JOINTS]))
        state = machine_state(graph, policy.observation_names, observation)
        place = graph.add("Unsqueeze", state, graph.indices([1]))
        target = graph.add("GatherND", table, place, batch_dims=1)
    from_stance = graph.add("Sub", target, graph.constant(policy.robot.default_stance))
    return graph.add("Div", from_stance, graph.constant(policy.robot.action_scale))


def _evaluated(graph: GraphBuilder, tape: Tape, quantities: str) -> str:
    """Adds a tape's lines; its slots are columns."""
    # Sums end in nothing, and products in 1, where others are longer.
    zero = tape.n_variables + len(tape.constants)
    one, shift = zero + 1, 2
    constants = graph.constant([[*tape.constants, 0.0, 1.0]])
    n_rows = graph.add("Shape", quantities, start=0, end=1)
    width = graph.indices([len(tape.constants) + shift])
    repeated = graph.add("Expand", constants, graph.add("Concat", n_rows, width, axis=0))
    values = graph.add("Concat", quantities, repeated, axis=1)
    for line in tape.lines:
        operands = [[own + shift * (own >= zero) for own in node] for node in line.operands]
        added = _line(graph, line, operands, values, zero if line.operator == "sum" else one)
        values = graph.add("Concat", values, added, axis=1)
    outputs = tape.outputs + shift * (tape.outputs >= zero)
    return graph.taken(values, outputs)


def _line(
    graph: GraphBuilder, line: Line, operands: Sequence[list[int]], values: str, nothing: int
) -> str:
    """Adds one line, whose operands are columns of the values."""
    match line.operator:
        case "sum" | "product":
            longest = max(map(len, operands))
            padded = [own + [nothing] * (longest - len(own)) for own in operands]
            terms = graph.taken(values, np.ravel(padded))
            chains = graph.add("Reshape", terms, graph.indices([-1, len(padded), longest]))
            if line.operator == "product":
                return graph.add("ReduceProd", chains, axes=[2], keepdims=0)
            signs = [[*own, *[1.0] * (longest - len(own))] for own in line.signs]
            signed = graph.add("Mul", chains, graph.constant(signs))
            return graph.add("ReduceSum", signed, graph.indices([2]), keepdims=0)
        case "square" | "cube":
            (base,) = (graph.taken(values, own) for own in zip(*operands, strict=True))
            square = graph.add("Mul", base, base)
            return square if line.operator == "square" else graph.add("Mul", square, base)
        case operator:
            taken = (graph.taken(values, own) for own in zip(*operands, strict=True))
            return graph.add(_FUNCTIONS[operator], *taken)
