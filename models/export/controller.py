"""A whole controller as one C99 file with its header: from sensors to joint targets.

It acts in one gait, or in several, which it changes on request.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from glassgait.models.errors import InputError, shown
from glassgait.models.export.code import Code, Style, policy_code
from glassgait.models.export.day import day_code
from glassgait.models.export.language import Real, commented, is_identifier, rendered
from glassgait.models.export.policies import network_code, odometry_code
from glassgait.models.export.reward_machine import Case, cases, state_constants
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.policies.neural import MirroredNetwork, Network
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.switched import SwitchedPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.joint_law import JointLaw
from glassgait.models.robots.robot import Robot
from glassgait.models.robots.target_limits import TargetLimits
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.contact import LOW, UNCHANGED_STEPS
from glassgait.models.task.day import Day
from glassgait.models.task.gait import Gait
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.models.task.imu import GRAVITY
from glassgait.models.task.mode_machine import BEYOND, GREATEST_GRAVITY, LEAST_GRAVITY
from glassgait.models.task.observation import OVERDUE, Group, ObservationLayout
from glassgait.models.task.odometry import Odometry

Place = tuple[str, int, str]
"""Name of a place in the observation, where it begins, and what stands there."""

MOST_NAME = 40
"""Greatest number of characters of a controller's name, with which all its names begin."""

INITIALISED = 0x0A1C0DE5
"""What a controller holds that was initialised: memory that was not hardly holds it by chance."""

_GROUPS: dict[Group, tuple[str, str]] = {
    "joint position": ("JOINT_POSITION", "12: rad, from the default stance"),
    "joint velocity": ("JOINT_VELOCITY", "12: 0.05 * rad/s"),
    "gravity": ("GRAVITY_DIRECTION", "3: forward, left and up, a unit vector"),
    "angular velocity": ("ANGULAR_VELOCITY", "3: about these axes, 0.25 * rad/s"),
    "previous action": ("PREVIOUS_ACTION", "12: {scale:g} rad of target, from the default stance"),
    "machine state": ("RM_STATE", "{n}: 1 in that state of the machine, else 0"),
    "iterations": ("RM_ITERATIONS", "0.1 * control steps in that state"),
    "commanded iterations": ("COMMAND_RM_ITERATIONS", "0.1 * commanded ones"),
    "base velocity": ("BASE_VELOCITY", "3: estimated, forward, left and up, 2 * m/s"),
    "foot height": ("FOOT_HEIGHT", "4: estimated, m"),
}
"""Name of the place of each group's first entry, and what stands there."""


@dataclass(frozen=True)
class Interface:
    """What a caller of a controller's functions has to know of it.

    Attributes:
        name: What the names of its files, functions and types begin with.
        real: The type that it computes in.
        n_states: Number of states of each gait's machine.
        joint_law: How joints are to follow its targets, which it limits itself if they are to.
        has_imu: Whether it reads an IMU.
        has_odometry: Whether it estimates by odometry.
        has_day: Whether it lives through a day.
    """

    name: str
    real: Real
    n_states: tuple[int, ...]
    joint_law: JointLaw
    has_imu: bool
    has_odometry: bool
    has_day: bool


@dataclass(frozen=True)
class ControllerSource(Interface):
    """The text of a controller.

    Attributes:
        takes_state: Whether its policy's function takes the machine's state first.
        source: The C file.
        header: Its header.
    """

    takes_state: bool
    source: str
    header: str


@dataclass(frozen=True)
class GaitCode:
    """What a file holds of one of its gaits.

    Attributes:
        title: The gait's name, as comments have it.
        constant: Its name in the constant of its number.
        renamed: Whether that is another name.
        own: What the names of its functions begin with; those of its constants in capitals. Nothing
            where it is the only gait.
        digests: Of the gait, of the policy and of its estimator.
        constants: Name of the constant of each state.
        state_names: The states with their numbers.
        cases: What makes its machine leave each state.
        places: Where the parts of its observation begin.
        n_observations: Entries of its observation.
        estimator: Its estimator; none where that is odometry, which all gaits share.
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
    estimator: Code | None
    policy: Code


def write_controller(
    gait: Gait | GaitSwitch,
    controller: AlternatingController,
    *,
    name: str,
    policy_name: str,
    version: str,
    real: Real = "double",
    day: Day | None = None,
) -> ControllerSource:
    """Writes a controller that acts from sensors, and of several gaits from the requested one.

    Args:
        gait: The gait, whose reward machine runs, or several that change on request.
        controller: One policy alone, of several gaits a `SwitchedPolicy`.
        name: What the names of its files, functions and types begin with.
        policy_name: What its comments call the policy.
        version: Version of this project.
        real: The type to compute in.
        day: The robot's day, in some of whose modes the policy acts; it always does by default.

    Raises:
        InputError: if the name can be none in C, a day does not suit the controller, a policy is
            made for another gait or observation,
            or there is no C for its kind, or for its estimator.
    """
    refuse_other_than_names(name)
    policy = controller.policy
    switched = policy if isinstance(policy, SwitchedPolicy) else None
    estimator = controller.estimator
    odometry = estimator if isinstance(estimator, Odometry) else None
    has_odometry = odometry is not None
    limits, has_imu = controller.joint_law.limits, reads_imu(controller)
    gaits = _gait_codes(gait, controller, real)
    codes = [code for own in gaits for code in (own.policy, own.estimator) if code]
    first = gait.gaits[0] if isinstance(gait, GaitSwitch) else gait
    machine = gait.gait if isinstance(gait, GaitSwitch) else gait
    values: dict[str, Any] = {
        **_common_values(controller, machine, name, policy_name, version),
        "title": f"the {gaits[0].title}'s controller: {_described(policy, policy_name)}",
        "gaits": gaits,
        "only": gaits[0],
        "named": _named(codes, has_odometry=has_odometry),
        "initial": gaits[0].constants[first.states.index(first.initial)],
        "needs_elu": any("elu(" in code.functions for code in codes),
        "helpers": dict.fromkeys(text for code in codes for text in code.helpers),
        "takes_state": any(own.policy.takes_state for own in gaits),
        "arrays": [array for code in codes for array in code.arrays],
        "has_imu": has_imu,
        "observes_imu": policy.layout.imu,
        "gravity": GRAVITY,
        "day": day and day_code(day, policy.robot, limits),
        "beyond": BEYOND,
        "least_gravity": LEAST_GRAVITY**2,
        "greatest_gravity": GREATEST_GRAVITY**2,
        "odometry": odometry and odometry_code(odometry, policy.robot, name, real),
        **(
            _switching_values(switched, gaits, policy_name, has_odometry=has_odometry)
            if switched
            else {}
        ),
    }
    template = "switching_controller" if switched else "controller"
    source, header = (rendered(f"{template}.{end}", real, **values) for end in "ch")
    n_states = tuple(len(own.constants) for own in gaits)
    return ControllerSource(
        name=name,
        real=real,
        n_states=n_states,
        takes_state=values["takes_state"],
        joint_law=controller.joint_law,
        has_imu=has_imu,
        has_odometry=has_odometry,
        has_day=day is not None,
        source=source,
        header=header,
    )


def _named(codes: list[Code], *, has_odometry: bool) -> str:
    """Says what has numbers at the end of a file, of the codes of one gait."""
    if has_odometry:
        return "the policy"
    return "the estimator and the policy" if codes[0].arrays else "the estimator"


def _gait_codes(
    gait: Gait | GaitSwitch, controller: AlternatingController, real: Real
) -> list[GaitCode]:
    """Writes the machine, the estimator and the policy of each gait."""
    policy = controller.policy
    if not isinstance(policy, SwitchedPolicy):
        assert isinstance(gait, Gait)
        return [_gait_code(gait, controller, gait.name, "", real)]
    gaits = policy.switch.gaits
    parts = zip(gaits, policy.controllers, gait_identifiers(gaits), strict=True)
    return [_gait_code(*own, f"{own[-1]}_", real) for own in parts]


def _gait_code(
    gait: Gait, controller: AlternatingController, identifier: str, own: str, real: Real
) -> GaitCode:
    policy, estimator = controller.policy, exported_estimator(controller)
    layout = ObservationLayout(gait.n_states, imu=policy.layout.imu)
    is_odometry = isinstance(estimator, Odometry)
    # An expert gives its estimator alone.
    for one in (policy,) if is_odometry else (policy, controller.expert):
        one.check(robot=policy.robot, gait=gait, observation_names=layout.names)
    constants = state_constants(gait, own)
    return GaitCode(
        title=commented(gait.name),
        constant=identifier.upper(),
        renamed=identifier != gait.name,
        own=own,
        digests=(
            gait.digest(),
            policy.digest(),
            estimator.digest() if is_odometry else controller.expert.digest(),
        ),
        constants=constants,
        state_names=commented(", ".join(f"{i} {state}" for i, state in enumerate(gait.states))),
        cases=cases(gait, real, own),
        places=_places(policy.robot, layout),
        n_observations=layout.size,
        estimator=None
        if is_odometry
        else network_code(estimator, f"{own}estimator", f"{own}estimate", real),
        policy=policy_code(policy, Style(constants, real, own)),
    )


def _switching_values(
    switched: SwitchedPolicy, gaits: list[GaitCode], policy_name: str, *, has_odometry: bool
) -> dict[str, Any]:
    """Returns what the templates ask for where the gait changes."""
    switch = switched.switch
    n_states = [gait.n_states for gait in switch.gaits]
    first = np.cumsum([0, *n_states[:-1]])[:, None]
    return {
        "title": f"a controller that changes its gait: policy {commented(policy_name)}",
        **({} if has_odometry else {"named": "estimators and policies"}),
        "patience": switch.patience,
        "greatest_change": float(np.sqrt(switched.greatest_change)),
        # The tables by which a gait gives way, with states by their number in their gait.
        "distance": switch.distance.tolist(),
        "entered": (switch.entered - first).tolist(),
        "nearest": switch.nearest.tolist(),
        "shared_places": _shared(gaits[0].places),
        "n_states": [f"{own.own.upper()}N_STATES" for own in gaits],
        "n_observations": [f"{own.own.upper()}N_OBSERVATIONS" for own in gaits],
    }


def reads_imu(controller: AlternatingController) -> bool:
    """Returns whether a controller's policy, its odometry or its limits read an IMU."""
    odometry = isinstance(controller.estimator, Odometry)
    return odometry or controller.policy.layout.imu or controller.joint_law.limits is not None


def exported_estimator(controller: AlternatingController) -> Network | MirroredNetwork | Odometry:
    """Returns a controller's estimator.

    Raises:
        InputError: if it has none that can be exported.
    """
    estimator = controller.estimator
    if not isinstance(estimator, Network | MirroredNetwork | Odometry):
        raise InputError(
            f"the estimator of a {controller.expert.kind} policy cannot be exported; export one of "
            "an expert"
        )
    return estimator


def gait_identifiers(gaits: tuple[Gait, ...]) -> list[str]:
    """Names gaits as C can: as they are called, or else by their numbers, such as gait_0."""
    names = [gait.name.lower() for gait in gaits]
    if len(set(names)) < len(names) or not all(map(is_identifier, names)):
        return [f"gait_{number}" for number in range(len(gaits))]
    return names


def _common_values(
    controller: AlternatingController, gait: Gait, name: str, policy_name: str, version: str
) -> dict[str, Any]:
    """Returns what the templates of every controller ask for; several gaits are given as one."""
    robot = controller.robot
    stiffness, damping = controller.joint_law.gains_of(robot)
    return {
        "name": name,
        "prefix": name.upper(),
        "robot": commented(robot.full_name),
        "gait": gait,
        "policy_name": commented(policy_name),
        "version": commented(version),
        "legs": list(quadruped.LEGS),
        "stance": robot.default_stance.tolist(),
        "limits_targets": controller.joint_law.limited,
        "limits": controller.joint_law.limits,
        **_ranges(robot, controller.joint_law.limits),
        "mark": INITIALISED,
        "action_scale": robot.action_scale,
        "stiffness": stiffness,
        "damping": damping,
        "constants_of_robot": _constants_of_robot(robot, gait, stiffness, damping),
        "period": CONTROL_PERIOD,
        "rate": round(1.0 / CONTROL_PERIOD),
        "overdue": OVERDUE,
        "unchanged_steps": UNCHANGED_STEPS,
        "low": LOW,
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


def _constants_of_robot(
    robot: Robot, gait: Gait, stiffness: float, damping: float
) -> list[tuple[str, float, str]]:
    """Lists the numbers that a caller may need, with what they are."""
    return [
        ("PERIOD", CONTROL_PERIOD, "s between two steps"),
        ("STIFFNESS", stiffness, "kp of every joint, N m/rad"),
        ("DAMPING", damping, "kd of every joint, N m s/rad, to velocity 0"),
        *_efforts(robot),
        ("MAX_SPEED", gait.max_speed, "greatest command, forward and back, m/s"),
        ("MAX_YAW_RATE", gait.max_yaw_rate, "greatest command, left and right, rad/s"),
        ("MIN_DWELL", float(gait.dwell[0]), "least command, control steps"),
        ("MAX_DWELL", float(gait.dwell[1]), "greatest command, control steps"),
    ]


def _ranges(robot: Robot, limits: TargetLimits | None) -> dict[str, Any]:
    """Returns the joints' ranges and their reach, three where all legs have the same."""
    values = {"lowest": robot.lower_limits, "highest": robot.upper_limits}
    if limits is not None:
        limits.check(robot)
        values["reach"] = robot.effort / limits.stiffness
    legs = (np.tile(own[:3], quadruped.N_LEGS) for own in values.values())
    shared = all(map(np.array_equal, values.values(), legs))
    count, index = (3, "joint % 3") if shared else (quadruped.N_JOINTS, "joint")
    return {"limit": index, **{name: own[:count].tolist() for name, own in values.items()}}


def _efforts(robot: Robot) -> list[tuple[str, float, str]]:
    """Lists the greatest torques, one where it is of all joints."""
    if np.ptp(robot.effort) == 0.0:
        return [("EFFORT", float(robot.effort[0]), "greatest torque of a joint, N m")]
    return [
        (f"EFFORT_{joint.upper()}", float(effort), "its greatest torque, N m")
        for joint, effort in zip(quadruped.JOINTS, robot.effort, strict=True)
    ]


def _described(policy: Policy, policy_name: str) -> str:
    """Returns a policy's name, and its kind where that is another word."""
    kind = policy.kind.replace("_", " ")
    named = commented(policy_name)
    return f"policy {named}" if named == policy.kind else f"policy {named}, {kind}"


def _places(robot: Robot, layout: ObservationLayout) -> list[Place]:
    """Lists where each part of the observation begins."""
    found = [("COMMAND_X", 0, "m/s"), ("COMMAND_YAW", 1, "rad/s")]
    groups = [entry.group for entry in layout.entries]
    for group, (title, note) in _GROUPS.items():
        if group in groups:
            filled = note.format(n=layout.n_machine_states, scale=robot.action_scale)
            found.append((title, groups.index(group), filled))
    return found


def _shared(found: list[Place]) -> list[Place]:
    """Returns the places that are the same in all gaits: up to the machine's first state."""
    titles = [title for title, _, _ in found]
    shared = found[: titles.index("RM_STATE")]
    return [*shared, ("RM_STATE", found[len(shared)][1], "1 in that state of the machine, else 0")]
