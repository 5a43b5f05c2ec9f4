"""What a deployment stack has to know of a policy's graph, as text by key."""

import json
from collections.abc import Iterable

from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import OVERDUE, Group, ObservationEntry, ObservationLayout

TERMS: dict[Group, str] = {
    "commanded velocity": "command",
    "joint position": "joint_pos",
    "joint velocity": "joint_vel",
    "previous action": "actions",
    "machine state": "rm_state",
    "iterations": "rm_iterations",
    "commanded iterations": "command_rm_iterations",
}
"""How deployment stacks call groups of observations, and what ours are called where they have no
such group."""


def metadata(
    gait: Gait, policy: Policy, expert: NeuralPolicy, *, policy_name: str, version: str
) -> dict[str, str]:
    """Describes a policy's graph; lists are separated by commas, numbers are in full.

    Args:
        gait: The gait.
        policy: The controller.
        expert: Its estimator observes what no sensor measures.
        policy_name: What the policy is called.
        version: Version of this project.
    """
    layout = ObservationLayout(gait.n_states)
    own = layout.entries[: layout.n_proprioceptive]
    groups: dict[Group, list[ObservationEntry]] = {}
    for entry in own:
        groups.setdefault(entry.group, []).append(entry)
    robot, n = policy.robot, quadruped.N_JOINTS
    # The last action is observed as it was given, where formulas hold its target.
    scales = [
        1.0 if group == "previous action" else entries[0].factor
        for group, entries in groups.items()
    ]
    return {
        "robot": robot.name,
        "joint_names": _listed(quadruped.JOINTS),
        "joint_stiffness": _listed([robot.stiffness] * n),
        "joint_damping": _listed([robot.damping] * n),
        "joint_effort_limit": _listed(robot.effort.tolist()),
        "joint_pos_lower_limit": _listed(robot.lower_limits.tolist()),
        "joint_pos_upper_limit": _listed(robot.upper_limits.tolist()),
        "limit_targets": json.dumps(policy.limits_targets or expert.limits_targets),
        "default_joint_pos": _listed(robot.default_stance.tolist()),
        "action_scale": _listed([robot.action_scale] * n),
        "command_names": "twist,rm_iterations",
        "observation_names": _listed(TERMS[group] for group in groups),
        "observation_terms_size": _listed(len(entries) for entries in groups.values()),
        "observation_terms_scale": _listed(scales),
        "observation_entries": _listed(entry.name for entry in own),
        "estimate_entries": _listed(entry.name for entry in layout.entries[len(own) :]),
        "control_period": repr(CONTROL_PERIOD),
        "command_ranges": json.dumps(
            {
                "speed": [-gait.max_speed, gait.max_speed],
                "yaw_rate": [-gait.max_yaw_rate, gait.max_yaw_rate],
                "rm_iterations": list(gait.dwell),
            }
        ),
        "gait": gait.name,
        "reward_machine": json.dumps(_machine(gait)),
        "policy": policy_name,
        "policy_kind": policy.kind,
        "gait_digest": gait.digest(),
        "policy_digest": policy.digest(),
        "estimator_digest": expert.digest(),
        "glassgait_version": version,
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
