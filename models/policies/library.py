"""Loads policies of all kinds from files, and finds those that ship."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from glassgait.models.errors import InputError, shown, unknown_name
from glassgait.models.files import load_arrays, read_text, read_yaml
from glassgait.models.policies.policy import FORMAT_VERSION, Policy
from glassgait.models.robots.library import load_robot, robot_folder, robot_of
from glassgait.models.robots.robot import DEFAULT_ROBOT, JointLaw, Robot
from glassgait.models.task.observation import ObservationLayout

if TYPE_CHECKING:
    from glassgait.models.formulas.file import FormulaFile
    from glassgait.models.task.gait import Gait

FORMULAS = ".formulas"
POLICY_SUFFIXES = (Policy.suffix, FORMULAS)

EXPERT_DIRECTORY = Path(__file__).parents[1] / "experts"
STUDENT_DIRECTORY = Path(__file__).parents[1] / "students"

_CLASSES = {
    "neural": ("neural", "NeuralPolicy"),
    "described": ("described", "DescribedPolicy"),
    "linear": ("linear", "LinearPolicy"),
    "linear_per_state": ("linear", "LinearPerStatePolicy"),
    "boosted_trees": ("boosting", "BoostedTreesPolicy"),
    "additive": ("additive", "AdditivePolicy"),
}
"""Module and class of each kind, so that loading one kind does not import the others."""

EXPERTS = ("neural", "described")  # kinds of experts, which act without another policy's estimator

RECORDS = ("distillation.yaml", "config.yaml")
"""Files beside students that may name their expert: in the package, and in a run's folder."""


def policy_path(folder: Path, name: str) -> Path:
    """Returns the path of a policy in a folder, even if no such file exists."""
    paths = [folder / f"{name}{suffix}" for suffix in POLICY_SUFFIXES]
    return next((path for path in paths if path.exists()), paths[0])


def load_policy(path: str | Path, robot: Robot | None = None) -> Policy:
    """Loads a policy of any kind, by default for the shipped robot that its file names."""
    path = Path(path)

    # Formula files are text.
    if path.suffix == FORMULAS:
        from glassgait.models.policies.symbolic import FormulaPolicy  # noqa: PLC0415

        with naming(path):
            file = _read_formula_file(path)
            return FormulaPolicy.from_file(file, robot_of(path, file.robot, robot))

    # All other files contain arrays and a header.
    arrays, header = load_arrays(path)
    _check_header(path, header)
    if (kind := header["kind"]) not in _CLASSES:
        raise InputError(f"{path}: key 'kind' of its header is {shown(kind)}; make it again")
    module, name = _CLASSES[kind]
    policy_class = getattr(import_module(f"glassgait.models.policies.{module}"), name)
    names = {"gait": header["gait"], "observation_names": tuple(header["observation_names"])}
    robot = robot_of(path, header.get("robot"), robot)
    with naming(path):
        law = JointLaw.from_plain(header.get("joint_law", {}), JointLaw.title)
        policy = policy_class.from_arrays(arrays, header["values"], robot=robot, **names)
        return policy.with_joint_law(law)


def _check_header(path: Path, header: Any) -> None:
    if not isinstance(header, Mapping) or header.get("format") != FORMAT_VERSION:
        raise InputError(f"{path}: is not a policy of format {FORMAT_VERSION}; make it again")
    types = {"kind": str, "gait": str, "observation_names": list, "values": dict}
    for key, expected in types.items():
        if not isinstance(header.get(key), expected):
            value = shown(header.get(key))
            raise InputError(f"{path}: key {key!r} of its header is {value}; make the policy again")


def _read_formula_file(path: Path) -> "FormulaFile":
    from glassgait.models.formulas.reader import read_formulas  # noqa: PLC0415

    # Keep a byte-order mark, which the certificate checker refuses as well.
    return read_formulas(read_text(path, encoding="utf-8"))


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Prefixes the message of an InputError with a file's path, unless it begins with it."""
    try:
        yield
    except InputError as error:
        if str(error).startswith(str(path)):
            raise
        raise InputError(f"{path}: {error}") from error


def find_gait(gait: str | Path, robot: str | None = None) -> "Gait":
    """Loads a gait by name, from a gait file, or from a formula file of the given robot."""
    from glassgait.models.task.gait import load_gait  # noqa: PLC0415

    path = Path(gait)
    if path.suffix != FORMULAS:
        return load_gait(gait)
    with naming(path):
        file = _read_formula_file(path)
    if robot is not None:
        robot_of(path, file.robot, load_robot(robot))
    if file.machine is None:
        raise InputError(f"{path}: has no key 'machine'; name a gait, or a gait file")
    return file.machine


def shipped_experts(robot: str = DEFAULT_ROBOT) -> tuple[str, ...]:
    folder = robot_folder(EXPERT_DIRECTORY, robot)
    return tuple(sorted(path.stem for path in folder.glob("*.safetensors")))


def shipped_expert(gait: str, robot: str = DEFAULT_ROBOT) -> Path:
    """Returns the path of a gait's shipped expert, even if no such file exists."""
    return robot_folder(EXPERT_DIRECTORY, robot) / f"{gait}.safetensors"


def shipped_students(gait: str, robot: str = DEFAULT_ROBOT) -> tuple[str, ...]:
    folder = robot_folder(STUDENT_DIRECTORY, robot) / gait
    paths = (path for path in folder.glob("*") if path.suffix in POLICY_SUFFIXES)
    return tuple(sorted(path.stem for path in paths))


def recorded_expert(folder: Path) -> tuple[Path, str] | None:
    """Returns the file that names the expert of a folder's students, and the expert's digest."""
    for path in (folder / name for name in RECORDS):
        record = read_yaml(path) if path.exists() else None
        inputs = record.get("inputs") if isinstance(record, dict) else None
        if isinstance(inputs, dict) and isinstance(inputs.get("expert"), str):
            return path, inputs["expert"]
    return None


def load_student_of(expert: Policy, path: Path) -> Policy:
    """Loads a student, with the estimator of its expert unless its file contains one."""
    student = load_policy(path, expert.robot)
    names = expert.observation_names
    if student.estimator is not None and not callable(student.estimator):
        # Formulas with odometry may observe an IMU even if the expert does not.
        states = expert.layout.n_machine_states
        names = ObservationLayout(states, imu=student.layout.imu).names
    with naming(path):
        student.check(gait=expert.gait, observation_names=names)
    if student.estimator is not None:
        return student
    recorded = recorded_expert(path.parent)
    if recorded is not None and recorded[1] != expert.digest():
        raise InputError(
            f"{path}: uses the estimator of the expert {recorded[1]} ({recorded[0]}), but this "
            f"expert is {expert.digest()}; name the run that distilled it with --source"
        )
    return student.with_estimator_of(expert)


def load_student(gait: str, kind: str, robot: Robot | None = None) -> Policy:
    """Loads a shipped student, with its estimator."""
    robot = robot or load_robot()
    expert = load_expert(gait, robot=robot)
    if kind not in (shipped := shipped_students(gait, robot.name)):
        distill = f"glassgait distill --gait {gait}{robot.option}"
        remedy = f"; make others with '{distill}', and read a file with load_policy"
        raise unknown_name(f"{robot.name} {gait} student", kind, shipped, remedy)
    folder = robot_folder(STUDENT_DIRECTORY, robot.name) / gait
    return load_student_of(expert, policy_path(folder, kind))


def load_expert(gait: "str | Gait", path: Path | None = None, robot: Robot | None = None) -> Policy:
    """Loads the expert of a gait, by default from the shipped file."""
    from glassgait.models.task.gait import gait_option, load_gait  # noqa: PLC0415

    # Find the file.
    machine = load_gait(gait) if isinstance(gait, str) else gait
    if path is None:
        robot = robot or load_robot()
        path = shipped_expert(machine.name, robot.name)
        if not path.exists():
            raise InputError(
                f"no expert for gait {machine.name!r} of the {robot.name} ships; train one with "
                f"'glassgait train {gait_option(machine.name)}{robot.option}', or give --source"
            )

    # Check that it contains a network for this gait and its RM states.
    policy = load_policy(path, robot)
    if policy.kind not in EXPERTS:
        raise InputError(f"{path}: holds a {policy.kind} policy; an expert is neural")
    if policy.gait != machine.name:
        raise InputError(
            f"{path}: is an expert for gait {policy.gait!r}, not {machine.name!r}; name another"
        )
    layout = ObservationLayout(machine.n_states, imu=policy.layout.imu)
    if policy.observation_names != layout.names:
        raise InputError(
            f"{path}: has other RM states than the {machine.name} has now; train it again"
        )
    return policy
