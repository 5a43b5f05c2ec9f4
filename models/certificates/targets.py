"""The targets of a policy of any kind that bounds can be proved for."""

from glassgait.models.certificates.additive_targets import AdditiveTargets
from glassgait.models.certificates.formula_targets import FormulaTargets
from glassgait.models.certificates.question import Targets
from glassgait.models.certificates.tree_targets import TreeTargets
from glassgait.models.errors import InputError
from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.policies.linear import LinearPolicy, StatewiseLinearPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.task.observation import indices_of


def targets_of(policy: Policy) -> Targets:
    """Returns the targets of a policy.

    Raises:
        InputError: if nothing can be proved of this kind of policy.
    """
    n_states = max(1, len(indices_of("machine state", policy.observation_names)))
    match policy:
        case FormulaPolicy():
            return FormulaTargets.of_formulas(policy, n_states)
        case LinearPolicy() | StatewiseLinearPolicy():
            return FormulaTargets.of_linear(policy, n_states)
        case AdditivePolicy():
            return AdditiveTargets(policy)
        case BoostedTreesPolicy():
            return TreeTargets(policy)
    raise InputError(
        f"of a policy of kind {policy.kind!r} nothing is proved; name formulas, a linear, an "
        "additive or a boosted one"
    )
