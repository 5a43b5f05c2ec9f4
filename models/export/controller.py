"""A whole controller as one C99 file with its header: from sensors to joint targets."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from glassgait.models.errors import InputError, shown
from glassgait.models.export.code import Style, policy_code
from glassgait.models.export.language import Real, commented, is_identifier, rendered
from glassgait.models.export.policies import network_code
from glassgait.models.export.reward_machine import cases, state_constants
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import OVERDUE, Group, ObservationLayout

MOST_NAME = 40
"""Greatest number of characters of a controller's name, with which all its names begin."""

INITIALISED = 0x0A1C0DE5
"""What a controller holds that was initialised: memory that was not hardly holds it by chance."""

_GROUPS: dict[Group, tuple[str, str]] = {
    "joint position": ("JOINT_POSITION", "12: rad, from the default stance"),
    "joint velocity": ("JOINT_VELOCITY", "12: 0.05 * rad/s"),
    "previous action": ("PREVIOUS_ACTION", "12: {scale:g} rad of target, from the default stance"),
    "machine state": ("RM_STATE", "{n}: 1 in that state of the machine, else 0"),
    "iterations": ("RM_ITERATIONS", "0.1 * control steps in that state"),
    "commanded iterations": ("COMMAND_RM_ITERATIONS", "0.1 * commanded ones"),
    "base velocity": ("BASE_VELOCITY", "3: estimated, forward, left and up, 2 * m/s"),
    "foot height": ("FOOT_HEIGHT", "4: estimated, m"),
}
"""Name of the place of each group's first entry, and what stands there."""


@dataclass(frozen=True)
class ControllerSource:
    """The text of a controller.

    Attributes:
        name: What the names of its files, functions and types begin with.
        real: The type that it computes in.
        n_states: Number of states of each gait's machine.
        takes_state: Whether its policy's function takes the machine's state first.
        limits_targets: Whether its targets stay within the joints' ranges.
        source: The C file.
        header: Its header.
    """

    name: str
    real: Real
    n_states: tuple[int, ...]
    takes_state: bool
    limits_targets: bool
    source: str
    header: str


def write_controller(
    gait: Gait,
    policy: Policy,
    expert: NeuralPolicy,
    *,
    name: str,
    policy_name: str,
    version: str,
    real: Real = "double",
) -> ControllerSource:
    """Writes a controller that acts by a policy, from sensors alone.

    Args:
        gait: The gait, whose reward machine runs.
        policy: The policy that acts: a student, or the expert.
        expert: Its estimator observes what no sensor measures.
        name: What the names of its files, functions and types begin with.
        policy_name: What its comments call the policy.
        version: Version of this project.
        real: The type to compute in.

    Raises:
        InputError: if the name can be none in C, a policy is made for another gait or observation,
            or there is no C for its kind.
    """
    refuse_other_than_names(name)
    layout = ObservationLayout(gait.n_states)
    for one in (policy, expert):
        one.check(robot=policy.robot, gait=gait.name, observation_names=layout.names)
    constants = state_constants(gait)
    estimator = network_code(expert.estimator, "estimator", "estimate", real)
    acting = policy_code(policy, Style(constants, real))
    limits_targets = policy.limits_targets or expert.limits_targets
    values: dict[str, Any] = {
        **common_values(
            policy.robot, gait, name, policy_name, version, limits_targets=limits_targets
        ),
        "title": f"the {commented(gait.name)}'s controller: {described(policy, policy_name)}",
        "gait_name": commented(gait.name),
        "digests": {
            "gait": gait.digest(),
            "policy": policy.digest(),
            "estimator": expert.digest(),
        },
        "named": "the estimator and the policy" if acting.arrays else "the estimator",
        "constants": constants,
        "state_names": named_states(gait),
        "initial": constants[gait.states.index(gait.initial)],
        "own": "",
        "cases": cases(gait, real),
        "observation": places(policy.robot, layout),
        "n_observations": layout.size,
        "estimator": estimator,
        "policy": acting,
        "arrays": [*acting.arrays, *estimator.arrays],
    }
    source, header = (rendered(f"controller.{end}", real, **values) for end in "ch")
    return ControllerSource(
        name, real, (gait.n_states,), acting.takes_state, limits_targets, source, header
    )


def common_values(
    robot: Robot, gait: Gait, name: str, policy_name: str, version: str, *, limits_targets: bool
) -> dict[str, Any]:
    """Returns what the templates of every controller ask for.

    Args:
        robot: The robot.
        gait: The gait, or all of several as one.
        name: What the names of its files, functions and types begin with.
        policy_name: What its comments call the policy.
        version: Version of this project.
        limits_targets: Whether targets stay within the joints' ranges.
    """
    return {
        "name": name,
        "prefix": name.upper(),
        "robot": commented(robot.full_name),
        "gait": gait,
        "policy_name": commented(policy_name),
        "version": commented(version),
        "legs": list(quadruped.LEGS),
        "stance": robot.default_stance.tolist(),
        "limits_targets": limits_targets,
        **_ranges(robot),
        "mark": INITIALISED,
        "action_scale": robot.action_scale,
        "stiffness": robot.stiffness,
        "damping": robot.damping,
        "constants_of_robot": _constants_of_robot(robot, gait),
        "period": CONTROL_PERIOD,
        "rate": round(1.0 / CONTROL_PERIOD),
        "overdue": OVERDUE,
    }


def refuse_other_than_names(name: str) -> None:
    """Refuses what cannot name a controller and its files.

    Raises:
        InputError: if it cannot.
    """
    if not is_identifier(name) or name != name.lower() or len(name) > MOST_NAME:
        raise InputError(
            f"the controller's name is {shown(name)}; give one of at most {MOST_NAME} small "
            "letters, digits and _ that begins with a letter"
        )


def _constants_of_robot(robot: Robot, gait: Gait) -> list[tuple[str, float, str]]:
    """Lists the numbers that a caller may need, with what they are."""
    return [
        ("PERIOD", CONTROL_PERIOD, "s between two steps"),
        ("STIFFNESS", robot.stiffness, "kp of every joint, N m/rad"),
        ("DAMPING", robot.damping, "kd of every joint, N m s/rad, to velocity 0"),
        *_efforts(robot),
        ("MAX_SPEED", gait.max_speed, "greatest command, forward and back, m/s"),
        ("MAX_YAW_RATE", gait.max_yaw_rate, "greatest command, left and right, rad/s"),
        ("MIN_DWELL", float(gait.dwell[0]), "least command, control steps"),
        ("MAX_DWELL", float(gait.dwell[1]), "greatest command, control steps"),
    ]


def _ranges(robot: Robot) -> dict[str, Any]:
    """Returns the joints' ranges, three where all legs have the same."""
    low, high = robot.lower_limits, robot.upper_limits
    shared = all(np.array_equal(own, np.tile(own[:3], quadruped.N_LEGS)) for own in (low, high))
    count, index = (3, "joint % 3") if shared else (quadruped.N_JOINTS, "joint")
    return {"lowest": low[:count].tolist(), "highest": high[:count].tolist(), "limit": index}


def _efforts(robot: Robot) -> list[tuple[str, float, str]]:
    """Lists the greatest torques, one where it is of all joints."""
    if np.ptp(robot.effort) == 0.0:
        return [("EFFORT", float(robot.effort[0]), "greatest torque of a joint, N m")]
    return [
        (f"EFFORT_{joint.upper()}", float(effort), "its greatest torque, N m")
        for joint, effort in zip(quadruped.JOINTS, robot.effort, strict=True)
    ]


def described(policy: Policy, policy_name: str) -> str:
    """Returns a policy's name, and its kind where that is another word."""
    kind = policy.kind.replace("_", " ")
    named = commented(policy_name)
    return f"policy {named}" if named == policy.kind else f"policy {named}, {kind}"


def named_states(gait: Gait) -> str:
    """Lists the states of a gait's machine with their numbers."""
    return commented(", ".join(f"{i} {own}" for i, own in enumerate(gait.states)))


def places(robot: Robot, layout: ObservationLayout) -> list[tuple[str, int, str]]:
    """Lists where each part of the observation begins."""
    found = [("COMMAND_X", 0, "m/s"), ("COMMAND_YAW", 1, "rad/s")]
    groups = [entry.group for entry in layout.entries]
    for group, (title, note) in _GROUPS.items():
        found.append(
            (
                title,
                groups.index(group),
                note.format(n=layout.n_machine_states, scale=robot.action_scale),
            )
        )
    return found
