"""Where students are kept, and finding them."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from glassgait.models.errors import InputError, shown
from glassgait.models.policies.controller import AlternatingController, alone
from glassgait.models.policies.library import (
    POLICY_SUFFIXES,
    STUDENT_DIRECTORY,
    load_student_of,
    policy_path,
    shipped_students,
)
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.robots.robot import DEFAULT_ROBOT, robot_folder
from glassgait.studies.common.console import note
from glassgait.studies.common.policies import Policies
from glassgait.studies.common.run_folder import CONFIG_NAME, read_settings
from glassgait.studies.distillation.students.registry import STUDENTS, sums_of_terms
from glassgait.studies.distillation.students.student import ITSELF

DISTILLATION_FOLDER = Path("runs/distillation")


def distillation_folder(gait: str, robot: str = DEFAULT_ROBOT) -> Path:
    """Returns where a gait's distillation is kept, unless a person names another folder."""
    return robot_folder(DISTILLATION_FOLDER, robot) / gait


def samples_folder(folder: Path, kind: str) -> Path:
    """Returns where a run keeps the samples that a student of a kind is fitted to.

    Raises:
        InputError: if the folder holds a run of something else, or its settings are damaged.
    """
    collector = STUDENTS[kind].collector or kind
    if (folder / CONFIG_NAME).exists():
        collector = read_settings(folder, "distill").get("collector") or collector
    return folder / (kind if collector == ITSELF else str(collector))


def kept_students(folder: Path) -> tuple[str, ...]:
    """Lists the kinds of students that a run has finished."""
    return tuple(kind for kind in STUDENTS if policy_path(folder, kind).exists())


def load_students(folder: Path, expert: NeuralPolicy) -> dict[str, Policy]:
    """Loads the students of a run, by kind.

    Raises:
        InputError: if the folder holds none, or a student does not fit the expert.
    """
    kinds = kept_students(folder)
    if not kinds:
        raise InputError(
            f"{folder}: holds no students; make them with 'glassgait distill --gait {expert.gait}'"
        )
    return {kind: load_student_of(expert, policy_path(folder, kind)) for kind in kinds}


def load_shipped_students(expert: NeuralPolicy) -> dict[str, Policy]:
    """Loads the students of the expert's gait that ship with the project, by kind.

    They are in the order of tables; of a gait without any there are none.

    Raises:
        InputError: if a student does not fit the expert.
    """
    kinds = [kind for kind in STUDENTS if kind in shipped_students(expert.gait)]
    folder = STUDENT_DIRECTORY / expert.gait
    return {kind: load_student_of(expert, policy_path(folder, kind)) for kind in kinds}


def default_student(found: Policies) -> str:
    """Names the student of a gait that is explained where a person names none.

    Raises:
        InputError: if there is no student whose actions are sums of terms.
    """
    for kind in sums_of_terms():
        if kind in found.files:
            return kind
    gait = found.gait.name
    raise InputError(
        f"no student of the {gait} in {found.place} acts by a sum of terms; make one with "
        f"'glassgait distill --gait {gait} --students {sums_of_terms()[1]}', or name another run "
        "with --source"
    )


def find_student(name: str, expert: NeuralPolicy, folder: Path | None = None) -> Policy:
    """Loads a student by its kind or by its file.

    It notes which it takes, where it does not take the shipped one.

    Args:
        name: Kind of student, or path of a policy file.
        expert: The expert that it must fit.
        folder: Folder of a distillation; by default runs/distillation/<gait>, and where that lacks
            the student, the shipped one.

    Raises:
        InputError: if there is no such student, or it does not fit the expert.
    """
    path = student_file(name, expert.gait, folder)
    if folder is None and name in STUDENTS and path.parent == distillation_folder(expert.gait):
        shipped = name in shipped_students(expert.gait)
        why = "in place of the shipped one" if shipped else f"since none of the {expert.gait} ships"
        note(f"student: {path}, {why}")
    return load_student_of(expert, path)


def find_walker(
    name: str, expert: NeuralPolicy, folder: Path | None = None
) -> AlternatingController:
    """Finds a policy that walks alone, with the estimator that it observes by.

    A neural policy observes by its own estimator, and any other by the expert's.

    Args:
        name: `expert`, a kind of student, or the path of a policy file.
        expert: The expert that a student must fit.
        folder: Folder of a distillation; as `find_student` takes it.

    Raises:
        InputError: if there is no such policy, or it does not fit the expert.
    """
    policy = expert if name == "expert" else find_student(name, expert, folder)
    if isinstance(policy, NeuralPolicy):
        return alone(policy)
    return alone(policy, expert)


def find_walkers(
    names: Sequence[str], expert: NeuralPolicy, folder: Path | None, *, shipped: bool
) -> dict[str, AlternatingController]:
    """Finds policies that walk alone, by the names that folders call them.

    Args:
        names: As `find_walker` takes them; where there are none, the expert and its students: those
            of the folder, or those that ship.
        expert: The expert.
        folder: Folder of a distillation.
        shipped: Whether the expert is the one that ships, whose students ship with it.

    Raises:
        InputError: if there is no such policy, it does not fit, or two are called the same.
    """
    if not names:
        students = load_students(folder, expert) if folder else {}
        if folder is None and shipped:
            students = load_shipped_students(expert)
        controllers = {kind: alone(own, expert) for kind, own in students.items()}
        return {"expert": alone(expert), **controllers}
    found: dict[str, AlternatingController] = {}
    for name in names:
        stem = Path(name).stem if Path(name).suffix in POLICY_SUFFIXES else name
        if stem in found:
            raise InputError(f"two policies are called {shown(stem)}; give one file another name")
        found[stem] = find_walker(name, expert, folder)
    return found


def inputs_of_walkers(walkers: Mapping[str, AlternatingController]) -> dict[str, str]:
    """Returns digests of policies that walk alone, as a run folder records them."""
    experts = {walker.expert.digest() for walker in walkers.values()}
    acting = (f"{name} {walker.policy.digest()}" for name, walker in walkers.items())
    return {"expert": " ".join(sorted(experts)), "policies": " ".join(acting)}


def student_file(name: str, gait: str, folder: Path | None = None) -> Path:
    """Returns the file of a student, which `find_student` loads.

    Raises:
        InputError: if there is no such student.
    """
    if name not in STUDENTS:
        if Path(name).suffix not in POLICY_SUFFIXES:
            raise InputError(
                f"unknown policy {shown(name)}; the policies are expert, {', '.join(STUDENTS)}, or "
                f"the path of a policy file ending in {' or '.join(POLICY_SUFFIXES)}"
            )
        return Path(name)
    path = policy_path(folder or distillation_folder(gait), name)
    if path.exists():
        return path
    if folder is None and name in shipped_students(gait):
        return policy_path(STUDENT_DIRECTORY / gait, name)
    raise InputError(
        f"no student {name!r} of the {gait}: {_kept(gait, folder)}; make it with "
        f"'glassgait distill --gait {gait} --students {name}'"
    )


def _kept(gait: str, folder: Path | None) -> str:
    """Lists the students of a gait, and where they are."""
    here = folder or distillation_folder(gait)
    kept = f"{here} holds {', '.join(kept_students(here)) or 'none'}"
    return kept if folder else f"{kept} (shipped: {', '.join(shipped_students(gait)) or 'none'})"
