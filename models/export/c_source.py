"""A whole controller as one C99 file with its header, from sensors to joint targets."""

import ast
import textwrap
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

import glassgait.models.export.c_formulas  # noqa: F401 (registers the C of formulas)
from glassgait.models import GRAVITY
from glassgait.models.errors import InputError, shown
from glassgait.models.estimation.odometry import SLIP, Odometry
from glassgait.models.estimation.sensors import LOW, UNCHANGED_STEPS
from glassgait.models.export.c_language import (
    LINE_LENGTH,
    Real,
    commented,
    is_identifier,
    number,
    rendered,
)
from glassgait.models.export.c_policies import Style, network_code, policy_code
from glassgait.models.formulas.grammar import GLUE
from glassgait.models.policies.controller import Controller
from glassgait.models.policies.neural import Network
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import JointLaw, Robot, TargetLimits
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait, Transition
from glassgait.models.task.observation import OVERDUE, Group, ObservationLayout

MOST_NAME = 40  # greatest number of characters of a controller's name, the prefix of all its names

INITIALISED = 0x0A1C0DE5
"""Mark of an initialised controller; other memory is unlikely to contain it."""

_GROUPS: dict[Group, tuple[str, str]] = {
    "joint position": ("JOINT_POSITION", "12: rad, from the default stance"),
    "joint velocity": ("JOINT_VELOCITY", "12: 0.05 * rad/s"),
    "gravity": ("GRAVITY_DIRECTION", "3: forward, left and up, a unit vector"),
    "angular velocity": ("ANGULAR_VELOCITY", "3: about these axes, 0.25 * rad/s"),
    "previous action": ("PREVIOUS_ACTION", "12: {scale:g} rad of target, from the default stance"),
    "machine state": ("RM_STATE", "{n}: 1 in that state of the machine, else 0"),
    "iterations": ("RM_ITERATIONS", "0.1 * control steps in that state"),
    "commanded iterations": ("COMMAND_RM_ITERATIONS", "0.1 * commanded control steps"),
    "base velocity": ("BASE_VELOCITY", "3: estimated, forward, left and up, 2 * m/s"),
    "foot height": ("FOOT_HEIGHT", "4: estimated, m"),
}
"""C constant of the index of each group's first entry, and its comment."""


@dataclass(frozen=True)
class Interface:
    name: str
    real: Real
    joint_law: JointLaw
    has_imu: bool
    has_odometry: bool


@dataclass(frozen=True)
class ControllerSource(Interface):
    source: str
    header: str


def write_controller(
    gait: Gait,
    controller: Controller,
    *,
    name: str,
    policy_name: str,
    version: str,
    real: Real = "double",
) -> ControllerSource:
    """Writes a controller of one policy, from sensors to joint targets.

    Names of its files, functions and types begin with `name`; `policy_name` is for comments.
    """
    # Check that the policy is made for the gait and its observation.
    check_name(name)
    policy, robot, law = controller.policy, controller.robot, controller.joint_law
    estimator = exported_estimator(controller)
    odometry = estimator if isinstance(estimator, Odometry) else None
    layout = ObservationLayout(gait.n_states, imu=policy.layout.imu)
    # A student without odometry uses the estimator of the expert.
    for used in (policy,) if odometry else (policy, controller.expert):
        used.check(robot=policy.robot, gait=gait, observation_names=layout.names)

    # Write the policy and its estimator.
    constants = state_constants(gait)
    acting = policy_code(policy, Style(constants, real))
    network = None
    if not isinstance(estimator, Odometry):
        network = network_code(estimator, "estimator", "estimate", real)
    codes = [acting] if network is None else [acting, network]
    # Name those whose numbers are at the end of the file.
    named = ["the estimator"] * (network is not None)
    named += ["the policy"] * (network is None or bool(acting.arrays))
    has_imu = reads_imu(controller)

    # Fill the templates with the numbers of the robot, the gait and the task.
    values: dict[str, Any] = {
        **_robot_values(robot, controller, gait),
        "name": name,
        "prefix": name.upper(),
        "gait": gait,
        "title": f"the {commented(gait.name)}'s controller: {_described(policy, policy_name)}",
        "gait_name": commented(gait.name),
        "policy_name": commented(policy_name),
        "version": commented(version),
        "digests": (
            gait.digest(),
            policy.digest(),
            odometry.digest() if odometry else controller.expert.digest(),
        ),
        "constants": constants,
        "state_names": commented(", ".join(f"{i} {state}" for i, state in enumerate(gait.states))),
        "initial": constants[gait.states.index(gait.initial)],
        "cases": machine_cases(gait, real),
        "places": _places(robot, layout),
        "n_observations": layout.size,
        "estimator": network,
        "policy": acting,
        "takes_state": acting.takes_state,
        "needs_elu": any("elu(" in code.functions for code in codes),
        "arrays": [array for code in codes for array in code.arrays],
        "named": " and ".join(named),
        "has_imu": has_imu,
        "observes_imu": policy.layout.imu,
        "odometry": odometry and _odometry_code(odometry, robot, real),
    }
    source, header = (rendered(f"controller.{end}", real, **values) for end in "ch")
    return ControllerSource(
        name=name,
        real=real,
        joint_law=law,
        has_imu=has_imu,
        has_odometry=odometry is not None,
        source=source,
        header=header,
    )


def check_name(name: str) -> None:
    if not is_identifier(name) or name != name.lower() or len(name) > MOST_NAME:
        raise InputError(
            f"the controller's name is {shown(name)}; give at most {MOST_NAME} of a-z, 0-9, _"
        )


def reads_imu(controller: Controller) -> bool:
    odometry = isinstance(controller.estimator, Odometry)
    return odometry or controller.policy.layout.imu or controller.joint_law.limits is not None


def exported_estimator(controller: Controller) -> Network | Odometry:
    """Returns a controller's estimator; raises InputError if it cannot be written as C."""
    estimator = controller.estimator
    if not isinstance(estimator, Network | Odometry):
        raise InputError(
            f"the estimator of a {controller.expert.kind} policy cannot be exported; name another"
        )
    return estimator


def _described(policy: Policy, policy_name: str) -> str:
    """Returns a policy's name, and its kind if that is different."""
    kind = policy.kind.replace("_", " ")
    named = commented(policy_name)
    return f"policy {named}" if named == policy.kind else f"policy {named}, {kind}"


def _places(robot: Robot, layout: ObservationLayout) -> list[tuple[str, int, str]]:
    places = [("COMMAND_X", 0, "m/s"), ("COMMAND_YAW", 1, "rad/s")]
    groups = [entry.group for entry in layout.entries]
    for group, (title, note) in _GROUPS.items():
        if group in groups:
            filled = note.format(n=layout.n_machine_states, scale=robot.action_scale)
            places.append((title, groups.index(group), filled))
    return places


# ---- The robot -------------------------------------------------------------------------------


def _robot_values(robot: Robot, controller: Controller, gait: Gait) -> dict[str, Any]:
    law = controller.joint_law
    stiffness, damping = law.gains_of(robot)
    return {
        # The robot and its joints.
        "robot": commented(robot.full_name),
        "legs": list(quadruped.LEGS),
        "stance": robot.default_stance.tolist(),
        "limits_targets": law.limited,
        "limits": law.limits,
        **_ranges(robot, law.limits),
        "mark": INITIALISED,
        "action_scale": robot.action_scale,
        "stiffness": stiffness if isinstance(stiffness, float) else "STIFFNESS",
        "damping": damping if isinstance(damping, float) else "DAMPING",
        "constants_of_robot": [
            ("PERIOD", CONTROL_PERIOD, "s between two steps"),
            *_by_joint("STIFFNESS", stiffness, "kp of {}, N m/rad"),
            *_by_joint("DAMPING", damping, "kd of {}, N m s/rad, for a target velocity of 0"),
            *_by_joint("EFFORT", robot.effort, "greatest torque of {}, N m"),
            ("MAX_SPEED", gait.max_speed, "greatest command, forward and backward, m/s"),
            ("MAX_YAW_RATE", gait.max_yaw_rate, "greatest command, left and right, rad/s"),
            ("MIN_DWELL", float(gait.dwell[0]), "least command, control steps"),
            ("MAX_DWELL", float(gait.dwell[1]), "greatest command, control steps"),
        ],
        # The task.
        "period": CONTROL_PERIOD,
        "rate": round(1.0 / CONTROL_PERIOD),
        "gravity": GRAVITY,
        "overdue": OVERDUE,
        "unchanged_steps": UNCHANGED_STEPS,
        "low": LOW,
    }


def _ranges(robot: Robot, limits: TargetLimits | None) -> dict[str, Any]:
    """Returns the joints' ranges and their reach, as three numbers if all legs are alike."""
    values = {"lowest": robot.lower_limits, "highest": robot.upper_limits}
    if limits is not None:
        limits.check(robot)
        values["reach"] = robot.effort / limits.stiffness
    legs = (np.tile(array[:3], quadruped.N_LEGS) for array in values.values())
    shared = all(map(np.array_equal, values.values(), legs))
    count, index = (3, "joint % 3") if shared else (quadruped.N_JOINTS, "joint")
    return {"limit": index, **{name: array[:count].tolist() for name, array in values.items()}}


def _by_joint(name: str, values: Any, note: str) -> list[tuple[str, float, str]]:
    # Write one constant if all joints share it.
    if np.ptp(values) == 0.0:
        return [(name, float(np.max(values)), note.format("every joint"))]
    return [
        (f"{name}_{joint.upper()}", float(value), note.format("this joint"))
        for joint, value in zip(quadruped.JOINTS, values, strict=True)
    ]


def _odometry_code(odometry: Odometry, robot: Robot, real: Real) -> str:
    return rendered(
        "odometry.c",
        real,
        legs=quadruped.LEGS,
        gain=odometry.gain,
        period=CONTROL_PERIOD,
        gravity=GRAVITY,
        slip=SLIP,
        thigh=robot.thigh_length,
        calf=robot.calf_length,
        radius=robot.foot_radius,
        offset=(robot.side * robot.thigh_offset).tolist(),
        hip=robot.hip_origin.tolist(),
    )


# ---- The reward machine ----------------------------------------------------------------------


class Case(NamedTuple):
    """The transitions from a state: formula, lines of the condition, next state's constant."""

    state: str
    exits: tuple[tuple[str, tuple[str, ...], str], ...]


def state_constants(gait: Gait) -> tuple[str, ...]:
    """Returns the C constants of RM states, with their names if all are valid, else numbers."""
    names = [f"STATE_{state.upper()}" for state in gait.states]
    if len(set(names)) < len(names) or not all(is_identifier(name) for name in names):
        return tuple(f"STATE_{index}" for index in range(len(names)))
    return tuple(names)


def machine_cases(gait: Gait, real: Real) -> list[Case]:
    named = dict(zip(gait.states, state_constants(gait), strict=True))
    cases = []
    for state in gait.states:
        exits = tuple(
            (commented(edge.when.text), _condition(edge, real), named[edge.target])
            for edge in gait.transitions
            if edge.source == state
        )
        if exits:
            cases.append(Case(named[state], exits))
    return cases


def _condition(edge: Transition, real: Real) -> tuple[str, ...]:
    """Returns the lines of a condition over `now`, the propositions of a control step."""
    # The formula, the clearance of swinging feet and the times must all hold.
    conditions = _conjuncts(ast.parse(edge.when.text, mode="eval").body)
    swings = zip(quadruped.LEGS, edge.when.swing_feet, strict=True)
    conditions += [f"now->height[{leg}] >= CLEARANCE" for leg, swing in swings if swing]
    if edge.dwell > 0.0:
        share = "" if edge.dwell == 1.0 else f"{number(edge.dwell, real)} * "
        conditions.append(f"now->spent >= {share}now->dwell")
    if edge.grace > 0:
        conditions.append(f"now->age >= {edge.grace}")

    # Break lines only between these conditions.
    glued = [condition.replace(" ", GLUE) for condition in conditions]
    lines = textwrap.wrap(f" &&{GLUE}".join(glued), LINE_LENGTH - 14, break_long_words=False)
    return tuple(line.replace(GLUE, " ") for line in lines)


def _conjuncts(node: ast.expr) -> list[str]:
    """Lists the conditions that must all hold; the gait has checked the formula."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitAnd):
        return [*_conjuncts(node.left), *_conjuncts(node.right)]
    return [_proposition(node)]


def _proposition(node: ast.expr) -> str:
    match node:
        case ast.Name(id=foot):
            return f"now->contact[{foot}]"
        case ast.UnaryOp(operand=operand):
            return f"!{_proposition(operand)}"
        case ast.BinOp(left=left, op=operator, right=right):
            sign = "&&" if isinstance(operator, ast.BitAnd) else "||"
            return f"({_proposition(left)} {sign} {_proposition(right)})"
    raise AssertionError(ast.unparse(node))
