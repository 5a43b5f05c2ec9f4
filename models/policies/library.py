"""Loading any policy from its file."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError, shown
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.files import read_text, read_yaml
from glassgait.models.formulas.reader import read_formulas
from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.policies.linear import LinearPolicy, StatewiseLinearPolicy
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.open_loop import OpenLoopPolicy
from glassgait.models.policies.policy import Policy, read_policy_file
from glassgait.models.policies.symbolic import (
    FormulaPolicy,
    StatewiseSymbolicPolicy,
    SymbolicPolicy,
)
from glassgait.models.robots.joint_law import JointLaw
from glassgait.models.robots.library import load_robot, robot_folder, robot_of
from glassgait.models.robots.robot import DEFAULT_ROBOT, Robot
from glassgait.models.task.gait import Gait, load_gait
from glassgait.models.task.observation import ObservationLayout

POLICY_CLASSES: dict[str, type[Policy]] = {
    policy.kind: policy
    for policy in (
        NeuralPolicy,
        OpenLoopPolicy,
        LinearPolicy,
        StatewiseLinearPolicy,
        BoostedTreesPolicy,
        AdditivePolicy,
        SymbolicPolicy,
        StatewiseSymbolicPolicy,
    )
}
"""The classes of policies that have files, by their kind.

A student that names a class of its own registers it; elsewhere POLICY_CLASSES[Own.kind] = Own does.
Its `to_arrays` and `from_arrays` hold all that it acts by, in arrays that `array_specs` lists or in
values; its files end in .safetensors.
"""

POLICY_SUFFIXES = tuple(dict.fromkeys(policy.suffix for policy in POLICY_CLASSES.values()))
"""How the names of policy files end."""

SAVED_TOLERANCE = 1e-9
"""Greatest difference of the actions of a policy and of its file, absolute and relative."""

EXPERT_DIRECTORY = Path(__file__).parents[1] / "experts"
STUDENT_DIRECTORY = Path(__file__).parents[1] / "students"

RECORDS = ("distillation.yaml", "config.yaml")
"""What may stand beside students and name their expert: where they ship, and in a run's folder."""


def policy_path(folder: Path, name: str) -> Path:
    """Returns where a folder keeps a policy, by the file that is there, or would keep it."""
    paths = [folder / f"{name}{suffix}" for suffix in POLICY_SUFFIXES]
    return next((path for path in paths if path.exists()), paths[0])


def load_policy(path: str | Path, robot: Robot | None = None) -> Policy:
    """Loads a policy of any kind.

    Args:
        path: Its file.
        robot: The robot that it has to be of; by default the one that ships which it names.

    Raises:
        InputError: if the file is missing, damaged, of an unknown kind, of another robot, or holds
            anything that a policy of its kind must not.
    """
    path = Path(path)
    if path.suffix == FormulaPolicy.suffix:
        with naming(path):
            file = read_formulas(_read_formula_text(path))
            return FormulaPolicy.from_file(file, robot_of(path, file.robot, robot))
    arrays, header = read_policy_file(path)
    policy = POLICY_CLASSES.get(header["kind"])
    if policy is None or issubclass(policy, FormulaPolicy):
        raise InputError(
            f"{path}: holds an unknown kind of policy, {shown(header['kind'])}; make it anew, or "
            "register the class of one of your own in POLICY_CLASSES"
        )
    names = {"gait": header["gait"], "observation_names": tuple(header["observation_names"])}
    robot = robot_of(path, header.get("robot"), robot)
    try:
        law = JointLaw.from_plain(header.get("joint_law", {}), JointLaw.title)
        own = policy.from_arrays(arrays, header["values"], robot=robot, **names)
        return own.with_joint_law(law)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _read_formula_text(path: Path) -> str:
    # The checker of certificates reads every byte.
    return read_text(path, encoding="utf-8")


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Puts a file's path, once, before what is wrong with it."""
    try:
        yield
    except InputError as error:
        if str(error).startswith(str(path)):
            raise
        raise InputError(f"{path}: {error}") from error


def find_gait(gait: str | Path, robot: str | None = None) -> Gait:
    """Loads a gait by its name, or from a gait file, or from a formula file that holds one.

    Args:
        gait: The name, or path of a file.
        robot: Name of a robot, or path of its robot.yaml, which a formula file has to be of; by
            default any.

    Raises:
        InputError: if there is no such gait, or the file breaks a rule of its kind, or is of
            another robot.
    """
    path = Path(gait)
    if path.suffix != FormulaPolicy.suffix:
        return load_gait(gait)
    with naming(path):
        file = read_formulas(_read_formula_text(path))
    if robot is not None:
        robot_of(path, file.robot, load_robot(robot))
    if file.machine is None:
        raise InputError(f"{path}: has no key 'machine'; name a gait, or a gait file")
    return file.machine


def save_policy(policy: Policy, path: Path, observations: Array) -> None:
    """Saves a policy, loads it again at once, and compares how both act.

    Args:
        path: Its file, which is deleted where it does not hold the policy.
        observations: Where the actions are compared (m, n).

    Raises:
        InputError: if the file cannot be written, cannot be loaded, or does not act as the policy.
    """
    policy.save(path)
    reason = None
    try:
        loaded = load_policy(path, policy.robot)(observations)
    except (InputError, AttributeError, KeyError, TypeError, ValueError) as error:
        reason = f"it cannot be loaded again ({error})"
    else:
        acted = policy(observations)
        # Sums over an array that lies otherwise in memory differ in their last bits.
        if not np.allclose(loaded, acted, rtol=SAVED_TOLERANCE, atol=SAVED_TOLERANCE):
            difference = np.abs(loaded - acted).max()
            reason = f"loaded again, its actions differ by up to {difference:.3g}"
    if reason is not None:
        path.unlink(missing_ok=True)
        raise InputError(
            f"{path}: does not hold the {type(policy).__name__}: {reason}; let its to_arrays and "
            "from_arrays hold all that it acts by, and register it in POLICY_CLASSES of "
            "glassgait.models.policies.library"
        )


def shipped_experts(robot: str = DEFAULT_ROBOT) -> tuple[str, ...]:
    """Lists the gaits whose expert for a robot ships with the project."""
    folder = robot_folder(EXPERT_DIRECTORY, robot)
    return tuple(sorted(path.stem for path in folder.glob("*.safetensors")))


def shipped_expert(gait: str, robot: str = DEFAULT_ROBOT) -> Path:
    """Returns where a gait's expert for a robot ships, or would ship."""
    return robot_folder(EXPERT_DIRECTORY, robot) / f"{gait}.safetensors"


def shipped_students(gait: str, robot: str = DEFAULT_ROBOT) -> tuple[str, ...]:
    """Lists the kinds of students of a gait for a robot that ship with the project."""
    folder = robot_folder(STUDENT_DIRECTORY, robot) / gait
    paths = (path for path in folder.glob("*") if path.suffix in POLICY_SUFFIXES)
    return tuple(sorted(path.stem for path in paths))


def recorded_expert(folder: Path) -> tuple[Path, str] | None:
    """Returns the digest of the expert that a folder's students were distilled with.

    Returns:
        The record that says so, and the digest; None where no record does.

    Raises:
        InputError: if a record cannot be read.
    """
    for path in (folder / name for name in RECORDS):
        found = read_yaml(path) if path.exists() else None
        inputs = found.get("inputs") if isinstance(found, dict) else None
        if isinstance(inputs, dict) and isinstance(inputs.get("expert"), str):
            return path, inputs["expert"]
    return None


def load_student_of(expert: Policy, path: Path) -> Policy:
    """Loads a student, with the estimator of its expert.

    A neural one has its own, and so have formulas whose file holds odometry; these may observe an
    IMU where the expert does not.

    Args:
        path: The student's file, beside which a record may name its expert.

    Raises:
        InputError: if the file is no policy, the student does not fit the expert, or it was
            distilled with another one.
    """
    student = load_policy(path, expert.robot)
    names = expert.observation_names
    if isinstance(student.estimator, Odometry):
        states = expert.layout.n_machine_states
        names = ObservationLayout(states, imu=student.layout.imu).names
    with naming(path):
        student.check(gait=expert.gait, observation_names=names)
    if student.estimator is not None:
        return student
    recorded = recorded_expert(path.parent)
    if recorded is not None and recorded[1] != expert.digest():
        raise InputError(
            f"{path}: observes by the estimator of the expert {recorded[1]} (key 'inputs.expert' "
            f"of {recorded[0]}), and this expert is {expert.digest()}; name the run "
            "that it was distilled in with --source, or distil a student from this one"
        )
    return student.with_estimator_of(expert)


def load_student(gait: str, kind: str, robot: Robot | None = None) -> Policy:
    """Loads a shipped student, with the estimator of the shipped expert.

    Raises:
        InputError: if no such student ships with the project, or the shipped expert is not the one
            that it was distilled with.
    """
    robot = robot or load_robot()
    shipped = shipped_students(gait, robot.name)
    if kind not in shipped:
        kinds = ", ".join(shipped) or "none"
        raise InputError(
            f"no student {shown(kind)} for gait {gait!r} of the {robot.name} ships with the "
            f"project (shipped: {kinds}); make it with 'glassgait distill --gait {gait}"
            f"{robot.option} --students {kind}'"
        )
    folder = robot_folder(STUDENT_DIRECTORY, robot.name) / gait
    return load_student_of(load_expert(gait, robot=robot), policy_path(folder, kind))


def load_expert(
    gait: str | Gait, path: Path | None = None, robot: Robot | None = None
) -> NeuralPolicy:
    """Loads the shipped expert of a gait, or one of one's own.

    Args:
        gait: The gait, or its name if it ships.
        path: The expert's file; the shipped one by default.
        robot: The robot; by default that of the file, and of what ships the default one.

    Raises:
        InputError: if there is no expert, or the file holds something else, or the expert of
            another gait.
    """
    machine = load_gait(gait) if isinstance(gait, str) else gait
    gait = machine.name
    if path is None:
        robot = robot or load_robot()
        path = shipped_expert(gait, robot.name)
        if not path.exists():
            raise InputError(
                f"no expert for gait {gait!r} of the {robot.name} ships with the project; train "
                f"one with 'glassgait train --gait {gait}{robot.option}', or name its run with "
                "--source"
            )
    policy = load_policy(path, robot)
    if not isinstance(policy, NeuralPolicy):
        raise InputError(f"{path}: holds a {policy.kind} policy; an expert is neural")
    if policy.gait != gait:
        raise InputError(f"{path}: is an expert for gait {policy.gait!r}, not {gait!r}")
    layout = ObservationLayout(machine.n_states, imu=policy.layout.imu)
    if policy.observation_names != layout.names:
        raise InputError(
            f"{path}: was trained for a {gait} of other states than the gait's file has now; train "
            "it anew"
        )
    return policy
