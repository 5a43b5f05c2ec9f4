"""The graphs of every policy but formulas, and of networks."""

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.export.graphs.builder import GraphBuilder
from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.policies.linear import LinearPolicy, StatewiseLinearPolicy
from glassgait.models.policies.neural import MirroredNetwork, Network, NeuralPolicy
from glassgait.models.policies.open_loop import OpenLoopPolicy
from glassgait.models.task.observation import ITERATIONS_SCALE, indices_of, machine_state_entries
from glassgait.models.task.symmetry import Reflection

_GOES_LEFT_IF_AT_MOST, _SUM, _AS_IT_IS = 0, 1, 0
"""How the operator numbers kinds of questions, of sums and of what is done with them."""


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
    steps = graph.whole(graph.add("Clip", counted, *ends))
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


def add_additive(graph: GraphBuilder, policy: AdditivePolicy, observation: str) -> str:
    """Adds sums of functions of one observation, and of two."""
    n_joints, n, bins = policy.tables.shape
    # All tables lie below one another; a row holds what a bin adds to all joints.
    effects = np.moveaxis(policy.tables, 0, -1).reshape(n * bins, n_joints)
    row = graph.add("Add", _bins(graph, policy.cuts, observation), _starts(graph, n, bins))
    added = graph.add("Gather", graph.constant(effects), row, axis=0)
    sums = graph.add("ReduceSum", added, graph.indices([1]), keepdims=0)
    action = graph.add("Add", sums, graph.constant(policy.intercepts))
    if len(policy.pairs):
        action = graph.add("Add", action, _of_pairs(graph, policy, observation))
    return action


def _of_pairs(graph: GraphBuilder, policy: AdditivePolicy, observation: str) -> str:
    n_pairs, bins, _ = policy.pair_tables.shape
    coarse = _bins(graph, policy.pair_cuts, observation)
    first, second = (graph.taken(coarse, own) for own in policy.pairs.T)
    inside = graph.add("Add", graph.add("Mul", first, graph.indices(bins)), second)
    place = graph.add("Add", inside, _starts(graph, n_pairs, bins * bins))
    effects = graph.add("Gather", graph.constant(policy.pair_tables.ravel()), place)
    of_joint = np.eye(len(policy.intercepts))[policy.pair_joints]
    return graph.add("MatMul", effects, graph.constant(of_joint))


def _bins(graph: GraphBuilder, cuts: Array, observation: str) -> str:
    """Adds the number of cuts that are at most as great, of each observation."""
    column = graph.add("Unsqueeze", observation, graph.indices([2]))
    passed = graph.add("GreaterOrEqual", column, graph.constant(cuts))
    counted = graph.whole(passed)
    return graph.add("ReduceSum", counted, graph.indices([2]), keepdims=0)


def _starts(graph: GraphBuilder, count: int, size: int) -> str:
    return graph.indices(size * np.arange(count))


def add_trees(graph: GraphBuilder, policy: BoostedTreesPolicy, observation: str) -> str:
    """Adds trees, whose leaves are summed up for each joint."""
    n_joints, n_trees, n_inner = policy.features.shape
    thresholds = policy.thresholds.reshape(-1, n_inner)
    kept = _reachable(thresholds)
    # The number of each inner node that is kept, counted through all trees.
    numbers = (np.cumsum(kept) - 1).reshape(kept.shape)
    tree, node = np.nonzero(kept)
    reached = _reached(thresholds)
    left = reached[tree, 2 * node + 1]
    # Where a threshold is infinite, which a root's may be, nothing goes right.
    right = np.where(np.isinf(thresholds[kept]), left, reached[tree, 2 * node + 2])
    branches = {
        side: (
            np.where(
                child < n_inner,
                numbers[tree, np.minimum(child, n_inner - 1)],
                tree * (n_inner + 1) + child - n_inner,
            ),
            child >= n_inner,
        )
        for side, child in {"true": left, "false": right}.items()
    }
    n_leaves = n_inner + 1
    sums = graph.add(
        "TreeEnsemble",
        observation,
        n_targets=n_joints,
        aggregate_function=_SUM,
        post_transform=_AS_IT_IS,
        tree_roots=numbers[:, 0].tolist(),
        nodes_modes=graph.tensor(np.full(len(node), _GOES_LEFT_IF_AT_MOST, dtype=np.uint8)),
        nodes_featureids=policy.features.reshape(-1, n_inner)[kept].tolist(),
        nodes_splits=graph.tensor(thresholds[kept]),
        leaf_targetids=np.repeat(np.arange(n_joints), n_trees * n_leaves).tolist(),
        leaf_weights=graph.tensor(policy.leaves.ravel()),
        **{f"nodes_{side}nodeids": ids.tolist() for side, (ids, _) in branches.items()},
        **{f"nodes_{side}leafs": leaf.astype(int).tolist() for side, (_, leaf) in branches.items()},
    )
    return graph.add("Add", sums, graph.constant(policy.intercepts))


def _reachable(thresholds: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Returns which inner nodes (trees, nodes) ask something: a root, and what can be reached."""
    asks = np.isfinite(thresholds)
    reachable = np.ones_like(asks)
    for node in range(1, asks.shape[1]):
        parent, goes_right = (node - 1) // 2, node % 2 == 0
        reachable[:, node] = reachable[:, parent] & (asks[:, parent] | (not goes_right))
    kept = reachable & asks
    kept[:, 0] = True
    return kept


def _reached(thresholds: NDArray[np.float64]) -> NDArray[np.intp]:
    """Finds the node (trees, 2 nodes + 1) that asks next, or the leaf, from each node on."""
    n_inner = thresholds.shape[1]
    reached = np.tile(np.arange(2 * n_inner + 1), (len(thresholds), 1))
    for node in reversed(range(n_inner)):
        ends_early = np.isinf(thresholds[:, node])
        reached[ends_early, node] = reached[ends_early, 2 * node + 1]
    return reached


def add_network(graph: GraphBuilder, network: Network | MirroredNetwork, value: str) -> str:
    """Adds a network that reads a value."""
    if not network.reflections:
        return _layers(graph, network.plain, value)
    reflect_input, reflect_output = network.reflections
    both = (value, _reflected(graph, reflect_input, value))
    stacked = (graph.add("Unsqueeze", one, graph.indices([0])) for one in both)
    outputs = _layers(graph, network.plain, graph.add("Concat", *stacked, axis=0))
    own, image = (graph.add("Gather", outputs, graph.indices(k), axis=0) for k in range(2))
    whole = graph.add("Add", own, _reflected(graph, reflect_output, image))
    return graph.add("Mul", whole, graph.constant(0.5))


def _layers(graph: GraphBuilder, network: Network, value: str) -> str:
    last = len(network.weights) - 1
    for place, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
        product = graph.add("MatMul", value, graph.constant(weight.T))
        value = graph.add("Add", product, graph.constant(bias))
        if place < last:
            value = _elu(graph, value)
    return value


def _elu(graph: GraphBuilder, value: str) -> str:
    """Adds the exponential linear unit, of which runtimes have no `Elu` for doubles."""
    zero, one = graph.constant(0.0), graph.constant(1.0)
    below = graph.add("Exp", graph.add("Min", value, zero))
    return graph.add("Add", graph.add("Max", value, zero), graph.add("Sub", below, one))


def _reflected(graph: GraphBuilder, reflection: Reflection, value: str) -> str:
    image = graph.taken(value, reflection.index)
    return graph.add("Mul", image, graph.constant(reflection.sign))


def add_neural(graph: GraphBuilder, policy: NeuralPolicy, observation: str) -> str:
    """Adds the network that acts."""
    return add_network(graph, policy.actor, observation)
