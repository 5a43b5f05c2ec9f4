"""A controller of several gaits as one C99 file with its header: it changes the gait on request."""

from dataclasses import dataclass

import numpy as np

from glassgait.models.errors import InputError
from glassgait.models.export.code import Code, Style, policy_code
from glassgait.models.export.controller import (
    ControllerSource,
    common_values,
    named_states,
    places,
    refuse_other_than_names,
)
from glassgait.models.export.language import Real, commented, is_identifier, rendered
from glassgait.models.export.policies import network_code
from glassgait.models.export.reward_machine import Case, cases, state_constants
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.switched import SwitchedPolicy
from glassgait.models.task.gait import Gait
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.models.task.observation import ObservationLayout

Place = tuple[str, int, str]
"""Name of a place in the observation, where it begins, and what stands there."""


@dataclass(frozen=True)
class GaitCode:
    """What a file holds of one of its gaits.

    Attributes:
        title: The gait's name, as comments have it.
        constant: Its name in the constant of its number.
        renamed: Whether that is another name.
        own: What the names of its functions begin with; those of its constants in capitals.
        digests: Of the gait, of the policy and of its estimator.
        constants: Name of the constant of each state.
        state_names: The states with their numbers.
        cases: What makes its machine leave each state.
        places: Where the parts of its observation begin that differ from gait to gait.
        n_observations: Entries of its observation.
        estimator: Its estimator.
        policy: Its policy.
    """

    title: str
    constant: str
    renamed: bool
    own: str
    digests: tuple[str, str, str]
    constants: tuple[str, ...]
    state_names: str
    cases: list[Case]
    places: list[Place]
    n_observations: int
    estimator: Code
    policy: Code


def write_switching_controller(
    switched: SwitchedPolicy,
    *,
    name: str,
    policy_name: str,
    version: str,
    real: Real = "double",
) -> ControllerSource:
    """Writes a controller of several gaits, from sensors and the requested gait alone.

    Args:
        switched: The gaits, and the policies that act and observe in each.
        name: What the names of its files, functions and types begin with.
        policy_name: What its comments call the policies.
        version: Version of this project.
        real: The type to compute in.

    Raises:
        InputError: if the name can be none in C, or there is no C for a policy or its estimator.
    """
    refuse_other_than_names(name)
    switch = switched.switch
    names = gait_identifiers(switch.gaits)
    gaits = [
        _gait_code(gait, policy, expert, own, real)
        for gait, policy, expert, own in zip(
            switch.gaits, switched.policies, switched.experts, names, strict=True
        )
    ]
    codes = [code for gait in gaits for code in (gait.policy, gait.estimator)]
    first = switch.gaits[0]
    values = {
        **common_values(
            switched.robot,
            switch.gait,
            name,
            policy_name,
            version,
            limits_targets=switched.limits_targets,
        ),
        "title": f"a controller that changes its gait: policy {commented(policy_name)}",
        "gaits": gaits,
        "named": "estimators and policies",
        "patience": switch.patience,
        "greatest_change": float(np.sqrt(switched.greatest_change)),
        "initial": gaits[0].constants[first.states.index(first.initial)],
        **_tables(switch),
        "shared_places": _shared(places(switched.robot, ObservationLayout(1))),
        "n_states": [f"{gait.own.upper()}N_STATES" for gait in gaits],
        "n_observations": [f"{gait.own.upper()}N_OBSERVATIONS" for gait in gaits],
        "most_observations": max(gait.n_observations for gait in gaits),
        "needs_elu": any("elu(" in code.functions for code in codes),
        "helpers": dict.fromkeys(text for code in codes for text in code.helpers),
        "takes_state": any(gait.policy.takes_state for gait in gaits),
        "arrays": [array for code in codes for array in code.arrays],
    }
    source, header = (rendered(f"switching_controller.{end}", real, **values) for end in "ch")
    n_states = tuple(gait.n_states for gait in switch.gaits)
    return ControllerSource(
        name, real, n_states, values["takes_state"], switched.limits_targets, source, header
    )


def gait_identifiers(gaits: tuple[Gait, ...]) -> list[str]:
    """Names gaits as C can: as they are called, or else by their numbers, such as gait_0."""
    names = [gait.name.lower() for gait in gaits]
    if len(set(names)) < len(names) or not all(map(is_identifier, names)):
        return [f"gait_{number}" for number in range(len(gaits))]
    return names


def _gait_code(gait: Gait, policy: Policy, expert: Policy, identifier: str, real: Real) -> GaitCode:
    if not isinstance(expert, NeuralPolicy):
        raise InputError(
            f"there is no C for the estimator of a {expert.kind} policy; export one of an expert"
        )
    own = f"{identifier}_"
    layout = ObservationLayout(gait.n_states)
    constants = state_constants(gait, own)
    shared = len(_shared(places(policy.robot, layout)))
    return GaitCode(
        title=commented(gait.name),
        constant=identifier.upper(),
        renamed=identifier != gait.name,
        own=own,
        digests=(gait.digest(), policy.digest(), expert.digest()),
        constants=constants,
        state_names=named_states(gait),
        cases=cases(gait, real, own),
        places=places(policy.robot, layout)[shared:],
        n_observations=layout.size,
        estimator=network_code(expert.estimator, f"{own}estimator", f"{own}estimate", real),
        policy=policy_code(policy, Style(constants, real, own)),
    )


def _shared(found: list[Place]) -> list[Place]:
    """Returns the places that are the same in all gaits: up to the machine's first state."""
    titles = [title for title, _, _ in found]
    shared = found[: titles.index("RM_STATE")]
    return [*shared, ("RM_STATE", found[len(shared)][1], "1 in that state of the machine, else 0")]


def _tables(switch: GaitSwitch) -> dict[str, list[list[int]]]:
    """Lists the tables by which a gait gives way to another, states by their number in the gait."""
    n_states = [gait.n_states for gait in switch.gaits]
    first = np.cumsum([0, *n_states[:-1]])[:, None]
    return {
        "distance": switch.distance.tolist(),
        "entered": (switch.entered - first).tolist(),
        "nearest": switch.nearest.tolist(),
    }
