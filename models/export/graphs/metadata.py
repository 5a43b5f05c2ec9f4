"""What a deployment stack has to know of a policy's graph, as text by key."""

import json
from collections.abc import Iterable

from glassgait.models.export.contract import ranges_of, terms_of
from glassgait.models.formulas.limits import limits_lines
from glassgait.models.formulas.odometry import odometry_lines
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.robots import quadruped
from glassgait.models.task.contact import LOW, UNCHANGED_STEPS
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import OVERDUE, Group, ObservationEntry, ObservationLayout
from glassgait.models.task.odometry import Odometry

TERMS: dict[Group, str] = {
    "commanded velocity": "command",
    "joint position": "joint_pos",
    "joint velocity": "joint_vel",
    "gravity": "projected_gravity",
    "angular velocity": "base_ang_vel",
    "previous action": "actions",
    "machine state": "rm_state",
    "iterations": "rm_iterations",
    "commanded iterations": "command_rm_iterations",
}
"""How deployment stacks call groups of observations, and what ours are called where they have no
such group."""

LENGTHS = ("thigh_offset", "thigh_length", "calf_length", "foot_radius")
"""Lengths of the robot by which its odometry and clearances are computed (m)."""


def metadata(
    gait: Gait, controller: AlternatingController, *, policy_name: str, version: str
) -> dict[str, str]:
    """Describes a policy's graph; lists are separated by commas, numbers are in full.

    Args:
        gait: The gait.
        controller: One policy alone, with what it estimates by.
        policy_name: What the policy is called.
        version: Version of this project.
    """
    policy, estimator = controller.policy, controller.estimator
    layout = policy.layout
    own = layout.entries[: layout.n_proprioceptive]
    groups: dict[Group, list[ObservationEntry]] = {}
    for entry in own:
        groups.setdefault(entry.group, []).append(entry)
    n, terms = quadruped.N_JOINTS, terms_of(policy.robot)
    ranges = {name: list(own) for name, own in ranges_of(gait).items()}
    ranges["rm_iterations"] = list(gait.dwell)
    del ranges["dwell"]
    stiffness, damping = controller.joint_law.gains_of(policy.robot)
    limits = controller.joint_law.limits
    # The last action is observed as it was given, where formulas hold its target.
    scales = [
        1.0 if group == "previous action" else entries[0].factor
        for group, entries in groups.items()
    ]
    return {
        "robot": str(terms["robot"]),
        "joint_names": _listed(terms["joints"]),
        "joint_stiffness": _listed([stiffness] * n),
        "joint_damping": _listed([damping] * n),
        "joint_effort_limit": _listed(terms["effort"]),
        "joint_pos_lower_limit": _listed(terms["lower_limits"]),
        "joint_pos_upper_limit": _listed(terms["upper_limits"]),
        "limit_targets": json.dumps(controller.joint_law.limited),
        **({} if limits is None else {"limits": "\n".join(limits_lines(limits))}),
        **{name: repr(terms[name]) for name in LENGTHS},
        "hip_offset": _listed(terms["hip_offset"]),
        "default_joint_pos": _listed(terms["stance"]),
        "action_scale": _listed([terms["action_scale"]] * n),
        "command_names": "twist,rm_iterations",
        "observation_names": _listed(TERMS[group] for group in groups),
        "observation_terms_size": _listed(len(entries) for entries in groups.values()),
        "observation_terms_scale": _listed(scales),
        "observation_entries": _listed(entry.name for entry in own),
        "estimate_entries": _listed(entry.name for entry in layout.entries[len(own) :]),
        "control_period": repr(terms["control_period"]),
        "command_ranges": json.dumps(ranges),
        "gait": gait.name,
        "reward_machine": json.dumps(_machine(gait)),
        "contact_trust": json.dumps({"unchanged_steps": UNCHANGED_STEPS, "low": LOW}),
        "policy": policy_name,
        "policy_kind": policy.kind,
        "gait_digest": gait.digest(),
        "policy_digest": policy.digest(),
        "estimator_digest": estimator.digest()
        if isinstance(estimator, Odometry)
        else controller.expert.digest(),
        "glassgait_version": version,
        **(_odometry(estimator, layout) if isinstance(estimator, Odometry) else {}),
    }


def _odometry(odometry: Odometry, layout: ObservationLayout) -> dict[str, str]:
    """Describes how a robot makes the estimate that the graph reads."""
    own = layout.entries[layout.n_proprioceptive :]
    return {
        "estimate_units": _listed(entry.unit for entry in own),
        "estimate_scale": _listed(entry.factor for entry in own),
        "odometry": "\n".join(odometry_lines(odometry)),
    }


def _listed(values: Iterable[object]) -> str:
    return ",".join(map(str, values))


def _machine(gait: Gait) -> dict[str, object]:
    """Describes a reward machine as the gait's file does, and when its observed time is held."""
    return {
        "states": list(gait.states),
        "initial": gait.initial,
        "clearance": gait.clearance,
        "overdue": OVERDUE,
        "transitions": [
            {
                "from": edge.source,
                "to": edge.target,
                "when": edge.when.text,
                "dwell": edge.dwell,
                "grace": edge.grace,
            }
            for edge in gait.transitions
        ],
    }
