"""What the terms of a target are made of: weights, and quantities whose values multiply them."""

from dataclasses import dataclass

from glassgait.models.formulas.expression import Expression, constant, variable
from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.linear import LinearPolicy, StatewiseLinearPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import FormulaPolicy


@dataclass(frozen=True)
class Product:
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


def products(policy: Policy, joint: int) -> tuple[Product, ...]:
    """Tells what each term of a joint's targets is made of, in the order of `policy.explain`.

    Args:
        policy: A policy whose actions are sums of terms.
        joint: Index of the joint.

    Raises:
        TypeError: if no such policy is known.
    """
    n = len(policy.observation_names)
    scale, stance = policy.robot.action_scale, policy.robot.default_stance[joint]
    match policy:
        case LinearPolicy():
            weights = [(weight,) for weight in (scale * policy.weights[joint]).tolist()]
            return _weighted((float(stance + scale * policy.intercepts[joint]),), weights)
        case StatewiseLinearPolicy():
            weights = [tuple(own) for own in (scale * policy.weights[:, joint]).T.tolist()]
            intercepts = stance + scale * policy.intercepts[:, joint]
            return _weighted(tuple(intercepts.tolist()), weights)
        case AdditivePolicy():
            pairs = policy.pairs[policy.pair_joints == joint].tolist()
            of = [(index,) for index in range(n)] + [tuple(pair) for pair in pairs]
            functions = (Product((), tuple(variable(index) for index in own)) for own in of)
            intercept = float(stance + scale * policy.intercepts[joint])
            return (Product((intercept,), ()), *functions)
        case FormulaPolicy():
            by_state = policy.formulas_by_state
            return tuple(
                _product(term, state if len(by_state) > 1 else None)
                for state, formulas in enumerate(by_state)
                for term in formulas[joint].terms()
            )
    raise TypeError(f"policies of kind {policy.kind!r} have no products")


def _weighted(
    intercept: tuple[float, ...], weights: list[tuple[float, ...]]
) -> tuple[Product, ...]:
    own = (Product(weight, (variable(index),)) for index, weight in enumerate(weights))
    return (Product(intercept, ()), *own)


def _product(term: Expression, state: int | None) -> Product:
    weight, quantities = 1.0, []
    for factor in _factors(term):
        if factor.operator == "constant":
            weight *= factor.value
        else:
            quantities.append(factor)
    # Variables first: functions of them may be long.
    quantities.sort(key=lambda quantity: quantity.operator != "variable")
    return Product((weight,), tuple(quantities), state)


def _factors(term: Expression) -> tuple[Expression, ...]:
    match term:
        case Expression("mul", (left, right)):
            return _factors(left) + _factors(right)
        case Expression("neg", (inner,)):
            return (constant(-1.0), *_factors(inner))
        case _:
            return (term,)
