"""The graphs of linear policies and of open-loop tables."""

from glassgait.models.export.graphs.builder import GraphBuilder
from glassgait.models.policies.linear import LinearPolicy, StatewiseLinearPolicy
from glassgait.models.policies.open_loop import OpenLoopPolicy
from glassgait.models.task.observation import (
    ITERATIONS_SCALE,
    indices_of,
    machine_state_entries,
)


def add_linear(graph: GraphBuilder, policy: LinearPolicy, observation: str) -> str:
    """Adds weighted sums of the observations."""
    sums = graph.add("MatMul", observation, graph.constant(policy.weights.T))
    return graph.add("Add", sums, graph.constant(policy.intercepts))


def add_statewise_linear(
    graph: GraphBuilder, policy: StatewiseLinearPolicy, observation: str
) -> str:
    """Adds weighted sums, others in each state of the machine."""
    state = machine_state(graph, policy.observation_names, observation)
    weights = graph.add("Gather", graph.constant(policy.weights), state, axis=0)
    column = graph.add("Unsqueeze", observation, graph.indices([2]))
    sums = graph.add("Squeeze", graph.add("MatMul", weights, column), graph.indices([2]))
    intercepts = graph.add("Gather", graph.constant(policy.intercepts), state, axis=0)
    return graph.add("Add", sums, intercepts)


def add_open_loop(graph: GraphBuilder, policy: OpenLoopPolicy, observation: str) -> str:
    """Adds a table of actions by state and time in it."""
    n_states, n_iterations, n_joints = policy.table.shape
    (place,) = indices_of("iterations", policy.observation_names)
    time = graph.columns(observation, place, place + 1)
    counted = graph.add("Round", graph.add("Div", time, graph.constant(ITERATIONS_SCALE)))
    ends = graph.constant(0.0), graph.constant(n_iterations - 1.0)
    steps = graph.add("Cast", graph.add("Clip", counted, *ends), to=7)
    first = graph.add(
        "Mul",
        machine_state(graph, policy.observation_names, observation),
        graph.indices(n_iterations),
    )
    row = graph.add("Add", first, graph.add("Squeeze", steps, graph.indices([1])))
    table = policy.table.reshape(n_states * n_iterations, n_joints)
    return graph.add("Gather", graph.constant(table), row, axis=0)


def machine_state(graph: GraphBuilder, names: tuple[str, ...], observation: str) -> str:
    """Adds the number of the machine's state, of each row."""
    own = machine_state_entries(names)
    one_hot = graph.columns(observation, own.start, own.stop)
    return graph.add("ArgMax", one_hot, axis=1, keepdims=0)
