"""What can be done with policies of a class, besides letting them act: a table in each class."""

from collections.abc import Callable
from dataclasses import dataclass
from pkgutil import resolve_name
from typing import Any, Literal

from glassgait.models.arrays import Array
from glassgait.models.formulas.expression import Expression

_MODELS = "glassgait.models"

Named = str | Callable[..., Any]
"""A function, or where it stands: "module:name" below `glassgait.models`, found when needed."""


@dataclass(frozen=True)
class FactoredTerm:
    """A term of a joint's target: a weight times quantities, or a function of them.

    Attributes:
        weights: The weight, one for all states of the machine or one each; none where the term is
            a function of its quantities.
        quantities: Variables of the policy, or functions of them.
        state: State of the machine whose formula the term is part of; None where it serves all.
    """

    weights: tuple[float, ...]
    quantities: tuple[Expression, ...]
    state: int | None = None


@dataclass(frozen=True)
class Capabilities:
    """What can be done with policies of a class; what is None cannot be done, and is refused.

    A class of one's own gives functions of its own, or those of another class.

    Attributes:
        factors: Returns what the terms of a joint's targets are made of, in the order of
            `Policy.explain`: `factors(policy, joint)`.
        importance: Returns the importance of observations that the policy's own shape gives, the
            name of the method and an array (12, n): `importance(policy, observations)`.
        code: Writes the policy in C: `code(policy, style)`.
        graph: Adds the policy to an ONNX graph, and returns the name of the action there:
            `graph(builder, policy, observation)`.
        stepwise: Whether actions are constant but for jumps, so that derivatives are 0.
    """

    factors: Callable[[Any, int], tuple[FactoredTerm, ...]] | None = None
    importance: Callable[[Any, Array], tuple[str, Array]] | None = None
    code: Named | None = None
    graph: Named | None = None
    stepwise: bool = False

    def function(self, name: Literal["code", "graph"]) -> Any:
        """Returns the function that does something; None where it cannot be done."""
        own = getattr(self, name)
        return resolve_name(f"{_MODELS}.{own}") if isinstance(own, str) else own


def weighted_terms(
    intercept: tuple[float, ...], weights: list[tuple[float, ...]]
) -> tuple[FactoredTerm, ...]:
    """Returns the terms of a weighted sum of variables: its constant, then one a variable."""
    own = (
        FactoredTerm(weight, (Expression("variable", variable=index),))
        for index, weight in enumerate(weights)
    )
    return (FactoredTerm(intercept, ()), *own)
