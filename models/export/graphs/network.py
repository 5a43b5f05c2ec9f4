"""The graph of networks, and of networks that treat left and right alike."""

from glassgait.models.export.graphs.builder import GraphBuilder
from glassgait.models.policies.neural import MirroredNetwork, Network
from glassgait.models.task.symmetry import Reflection


def add_network(graph: GraphBuilder, network: Network | MirroredNetwork, value: str) -> str:
    """Adds a network that reads a value."""
    if not isinstance(network, MirroredNetwork):
        return _layers(graph, network, value)
    both = (value, _reflected(graph, network.reflect_input, value))
    stacked = (graph.add("Unsqueeze", one, graph.indices([0])) for one in both)
    outputs = _layers(graph, network.network, graph.add("Concat", *stacked, axis=0))
    own, image = (graph.add("Gather", outputs, graph.indices(k), axis=0) for k in range(2))
    whole = graph.add("Add", own, _reflected(graph, network.reflect_output, image))
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
