"""The C of a policy of any kind."""

from collections.abc import Callable, Sequence
from typing import Any

from glassgait.models.errors import InputError
from glassgait.models.export.additive import additive_code
from glassgait.models.export.code import Code
from glassgait.models.export.formulas import formula_code
from glassgait.models.export.language import Real
from glassgait.models.export.linear import linear_code, open_loop_code
from glassgait.models.export.network import network_code
from glassgait.models.export.trees import trees_code
from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.policies.linear import LinearPolicy, StatewiseLinearPolicy
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.open_loop import OpenLoopPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import FormulaPolicy


def policy_code(policy: Policy, constants: Sequence[str], real: Real, own: str = "") -> Code:
    """Writes a policy; its last function maps the observation to the action.

    Args:
        policy: The policy.
        constants: Name of the constant of each state of the machine.
        real: The type that is computed in.
        own: What the names of its gait begin with, such as `trot_`; none where there is one gait.

    Raises:
        InputError: if there is no C for its kind.
    """
    writers: list[tuple[Any, Callable[[Any], Code]]] = [
        (FormulaPolicy, lambda one: formula_code(one, constants, real, own)),
        ((LinearPolicy, StatewiseLinearPolicy), lambda one: linear_code(one, real, own)),
        (AdditivePolicy, lambda one: additive_code(one, real, own)),
        (BoostedTreesPolicy, lambda one: trees_code(one, real, own)),
        (NeuralPolicy, lambda one: network_code(one.actor, f"{own}actor", f"{own}act", real)),
        (OpenLoopPolicy, lambda one: open_loop_code(one, real, own)),
    ]
    for kinds, write in writers:
        if isinstance(policy, kinds):
            return write(policy)
    raise InputError(f"there is no C for policies of kind {policy.kind!r}; export another one")
