"""Finding the policies of a gait: one rule for every command.

What ships is taken, unless `--source` names the folder of a run of train, distill or
refine. Of a gait that does not ship, the runs' default folders are taken: runs/train/<gait> and
runs/distill/<gait>; of another robot than the default one runs/train/<robot>/<gait> and so on.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from glassgait.models.errors import InputError, shown
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.files import read_yaml
from glassgait.models.policies.controller import AlternatingController, alone
from glassgait.models.policies.library import (
    POLICY_SUFFIXES,
    STUDENT_DIRECTORY,
    find_gait,
    load_expert,
    load_policy,
    load_student_of,
    naming,
    policy_path,
    recorded_expert,
    shipped_expert,
    shipped_experts,
)
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots.library import load_robot, robot_folder
from glassgait.models.robots.robot import DEFAULT_ROBOT, Robot
from glassgait.models.settings import Settings, checked
from glassgait.models.task.gait import Gait, gait_names
from glassgait.models.task.observation import ObservationLayout
from glassgait.studies.common.console import note
from glassgait.studies.common.run_folder import CHECKPOINT_NAME, CONFIG_NAME, default_folder

EXPERT = "expert"
"""Name of the expert."""

ALL = "all"
"""Name of the expert and all students together."""

SHIPPED = "shipped"
"""What records call the place of policies that ship."""

ORDER = (
    "linear",
    "statewise_linear",
    "gbm",
    "histogram_gbm",
    "ebm",
    "symbolic",
    "statewise_symbolic",
    "sparse_formula",
)
"""Order of the kinds of students in tables; kinds that it does not name come last."""


@dataclass(frozen=True)
class Policies:
    """The policies of a gait that a command can use.

    Attributes:
        gait: The gait.
        robot: The robot.
        place: `shipped`, or the folder of a run.
        expert_there: The expert; None where there is none, so that only policies act that need
            none: files of formulas that hold odometry.
        expert_place: Where the expert is from: `shipped`, or a file; where there is none, how to
            make one.
        files: Files of the students by kind, in the order of tables.
    """

    gait: Gait
    robot: Robot
    place: str
    expert_there: NeuralPolicy | None
    expert_place: str
    files: dict[str, Path]

    @property
    def expert(self) -> NeuralPolicy:
        """The expert, by whose estimator students observe.

        Raises:
            InputError: if there is none.
        """
        if self.expert_there is None:
            raise InputError(self.expert_place)
        return self.expert_there

    @property
    def folder(self) -> Path | None:
        """The folder of the run; None of what ships."""
        return None if self.place == SHIPPED else Path(self.place)

    def output(self, study: str) -> Path:
        """Returns where a command's run of these policies is kept by default."""
        return default_folder(study, self.robot.name) / self.gait.name

    @cached_property
    def students(self) -> dict[str, Policy]:
        """Every student, by kind.

        Raises:
            InputError: if a file is damaged, or a student does not fit the expert.
        """
        return {kind: load_student_of(self.expert, path) for kind, path in self.files.items()}

    def file(self, name: str) -> Path:
        """Returns the file of a policy.

        Args:
            name: `expert`, a kind of student, or the path of a policy file.

        Raises:
            InputError: if there is no such policy.
        """
        if name == EXPERT:
            ships = shipped_expert(self.gait.name, self.expert.robot.name)
            return ships if self.expert_place == SHIPPED else self._expert_file
        if is_file(name):
            return Path(name)
        if self.expert_there is None:
            raise InputError(self.expert_place)
        if name not in self.files:
            there = ", ".join((EXPERT, *self.files))
            of = f"--gait {self.gait.name}{self.robot.option}"
            remedy = f"; make it with 'glassgait distill {of} --students {name}'"
            raise InputError(
                f"--policy {shown(name)}: there is no such policy of the "
                f"{self.gait.name} of the {self.robot.name}; "
                f"{self._where()} are {there}{remedy if name in ORDER else ''}; name one of them, "
                f"the file of a policy ending in {' or '.join(POLICY_SUFFIXES)}, or another run "
                "with --source"
            )
        return self.files[name]

    @property
    def _expert_file(self) -> Path:
        place = Path(self.expert_place)
        return policy_path(place, self.gait.name) if place.is_dir() else place

    def policy(self, name: str) -> Policy:
        """Loads a policy.

        Args:
            name: `expert`, a kind of student, or the path of a policy file.

        Raises:
            InputError: if there is no such policy, or it does not fit gait and expert.
        """
        if name == EXPERT:
            policy = self.expert
        elif self.expert_there is None:
            policy = self._without_expert(self.file(name))
        else:
            path = self.file(name)
            policy = load_student_of(self._expert_of(path), path)
        with naming(self.file(name)):
            policy.refuse_other_machine(self.gait)
        return policy

    def formulas(self, name: str) -> FormulaPolicy:
        """Loads a policy that is made of formulas.

        Raises:
            InputError: if there is no such policy, it is of another kind, or does not fit.
        """
        policy = self.policy(name)
        if not isinstance(policy, FormulaPolicy):
            raise InputError(
                f"--policy {name}: is of the kind {policy.kind!r}, not made of formulas; name a "
                f"student of formulas, or a {FormulaPolicy.suffix} file"
            )
        return policy

    def controller(self, name: str) -> AlternatingController:
        """Loads a policy that acts alone, with the estimator that it observes by.

        A neural policy observes by its own estimator, and any other by its expert's, if there is
        one.
        """
        policy = self.policy(name)
        if isinstance(policy, NeuralPolicy) or self.expert_there is None:
            return alone(policy)
        return alone(policy, self.expert_of(name))

    def expert_of(self, name: str) -> NeuralPolicy | None:
        """Returns the expert by whose estimator a policy observes that has none of its own.

        None where there is none, and the policy needs none.

        Raises:
            InputError: if there is no such policy.
        """
        if self.expert_there is None:
            return None
        if name == EXPERT:
            return self.expert
        return self._expert_of(self.file(name))

    def controllers(self, names: Iterable[str]) -> dict[str, AlternatingController]:
        """Loads policies that act alone, by the names that folders and tables call them.

        Args:
            names: As `controller` takes them; `all` stands for the expert and every student.

        Raises:
            InputError: if there is no such policy, or it does not fit.
        """
        found: dict[str, AlternatingController] = {}
        for name in self.named(names):
            stem = policy_stem(name)
            # Of two files of one name the second is called by its path.
            found[name if stem in found else stem] = self.controller(name)
        return found

    def named(self, names: Iterable[str]) -> tuple[str, ...]:
        """Returns names, in which `all` is replaced by the expert and every student there is."""
        given = tuple(names)
        return (EXPERT, *self.files) if ALL in given else given

    def inputs(
        self, controllers: Iterable[tuple[str, AlternatingController]] = ()
    ) -> dict[str, str]:
        """Returns digests of what a run takes from here, as its record holds them.

        Args:
            controllers: Names and policies that act; of the expert alone none.
        """
        pairs = list(controllers)
        known = [] if self.expert_there is None else [self.expert_there]
        experts = {own.digest() for own in (*known, *(own.expert for _, own in pairs))}
        acting = (f"{name} {(own.student or own.expert).digest()}" for name, own in pairs)
        return {
            "gait": self.gait.digest(),
            "source": self.place,
            "expert": " ".join(sorted(experts)),
            "policies": " ".join(acting),
        }

    def _expert_of(self, path: Path) -> NeuralPolicy:
        """Loads the expert that a student observes by: the one its folder's record names."""
        recorded = recorded_expert(path.parent)
        if recorded is None or recorded[1] == self.expert.digest():
            return self.expert
        # Where the recorded expert is not found, loading the student says so.
        found = _find_recorded(self.gait, path.parent, self.expert.robot)
        return found[0] if found else self.expert

    def _without_expert(self, path: Path) -> Policy:
        policy = load_policy(path, self.robot)
        if not isinstance(policy.estimator, Odometry):
            raise InputError(f"{path}: needs its expert's estimator. {self.expert_place}")
        names = ObservationLayout(self.gait.n_states, imu=policy.layout.imu).names
        with naming(path):
            policy.check(gait=self.gait, observation_names=names)
        return policy

    def _where(self) -> str:
        return "shipped" if self.place == SHIPPED else f"in {self.place}"


def rank(kind: str) -> int:
    """Returns the place of a kind of student in tables."""
    return ORDER.index(kind) if kind in ORDER else len(ORDER)


def policy_stem(name: str) -> str:
    """Returns what tables and folders call a policy that is named by its kind or file."""
    return Path(name).stem if is_file(name) else name


def is_file(name: str) -> bool:
    """Returns whether a policy is named by its file, rather than by its kind."""
    return Path(name).suffix in POLICY_SUFFIXES


def find_policies(
    gait: Gait,
    source: Path | None = None,
    robot: str | None = None,
    *,
    names: Sequence[str] = (),
    quiet: bool = False,
) -> Policies:
    """Finds the policies of a gait, and prints where they are from.

    Args:
        gait: The gait.
        source: Folder of a run of train, distill or refine; by default what ships is
            taken and, of a gait that does not ship, what the default folders hold.
        robot: Name of the robot, or path of its robot.yaml; by default that of the run's policies,
            and of what ships the default one.
        names: Policies that are named: of files alone the line says where their expert is from.
        quiet: Whether nothing is printed.

    Raises:
        InputError: if the folder that is named holds no policies of the gait, or the expert that
            its students were distilled with is not found.
    """
    name = gait.name
    own = load_robot(robot or DEFAULT_ROBOT)
    if source is not None:
        found = _in_run(gait, source, own if robot else None)
    elif name in shipped_experts(own.name):
        files = _students_in(robot_folder(STUDENT_DIRECTORY, own.name) / name, name)
        found = Policies(gait, own, SHIPPED, load_expert(gait, robot=own), SHIPPED, files)
    else:
        folder = default_folder("distill", own.name) / name
        if not _students_in(folder, name):
            folder = default_folder("train", own.name) / name
        found = _in_run(gait, folder, own, asked=False)
    if quiet:
        return found
    if names and all(map(is_file, names)):
        expert = "the one that ships" if found.expert_place == SHIPPED else found.expert_place
        expert = "not found" if found.expert_there is None else expert
        note(f"{name}: policies are the files that are named; the expert is {expert}")
    elif found.expert_there is None:
        note(f"{name}: no expert is found; policies are files that need none")
    elif found.place == SHIPPED:
        note(f"{name}: policies are those that ship")
    elif found.expert_place == SHIPPED:
        note(f"{name}: policies are those of {found.place}, and the expert that ships")
    else:
        note(f"{name}: policies are those of {found.place}, and the expert {found.expert_place}")
    return found


def find_expert(gait: Gait, source: Path | None = None, robot: str | None = None) -> NeuralPolicy:
    """Finds the expert that students of a gait are to copy, and prints where it is from.

    Args:
        gait: The gait.
        source: Folder of a run of train; by default what ships is taken and, of a
            gait that does not ship, what runs/train/<gait> holds, students of an earlier expert
            or not.
        robot: Name of the robot, or path of its robot.yaml.

    Raises:
        InputError: as `find_policies`.
    """
    own = load_robot(robot or DEFAULT_ROBOT)
    if source is None and gait.name not in shipped_experts(own.name):
        source = default_folder("train", own.name) / gait.name
    return find_policies(gait, source, robot).expert


def find_policies_of(
    gaits: Sequence[Gait],
    source: Path | None = None,
    names: Iterable[str] = (),
    robot: str | None = None,
) -> dict[str, Policies]:
    """Finds the policies of several gaits, by the gaits' names.

    Raises:
        InputError: as `find_policies`, and if a folder or files, which are of one gait, are named
            for several.
    """
    if len(gaits) > 1 and (source is not None or any(is_file(name) for name in names)):
        raise InputError("--gait: several gaits take no files of your own; name one gait for them")
    return {gait.name: find_policies(gait, source, robot) for gait in gaits}


@checked
class PolicySource(Settings):
    """Settings of a command that takes policies.

    Attributes:
        robot: Name of a robot, or path of its robot.yaml; by default that of the policies.
        source: Folder of a run of train, distill or refine to take policies from; by
            default those that ship and, of a gait that does not ship, those of
            runs/distill/<gait> and runs/train/<gait>.
    """

    robot: str | None = None
    source: Path | None = None

    def policies_of(self, gait: str, *, quiet: bool = False) -> Policies:
        """Finds the policies of a gait, by its name or file, and prints where they are from.

        Raises:
            InputError: as `find_gait` and `find_policies`.
        """
        return find_policies(find_gait(gait, self.robot), self.source, self.robot, quiet=quiet)


@checked
class OneGait(PolicySource):
    """Settings of a command that takes policies of one gait.

    Attributes:
        gait: Name of a gait, or path of a gait file.
    """

    gait: str = "trot"

    def policies(self) -> Policies:
        """Finds the policies, and prints where they are from.

        Raises:
            InputError: as `policies_of`.
        """
        return self.policies_of(self.gait)


def _in_run(gait: Gait, folder: Path, robot: Robot | None, *, asked: bool = True) -> Policies:
    """Finds the policies of a run.

    Args:
        asked: Whether a person named the folder, which then must hold policies.
    """
    files = _students_in(folder, gait.name)
    own = policy_path(folder, gait.name)
    if own.exists() or files:
        _refuse_other_gait(gait, folder)
    if own.exists():
        expert = load_expert(gait, own, robot)
        return Policies(gait, expert.robot, str(folder), expert, str(own), files)
    if not files:
        # A gait of one's own is called as its file.
        of = f"--gait {gait.name}" + ("" if gait.name in gait_names() else ".yaml")
        if robot is not None:
            of += robot.option
        lacks = (
            f"{folder}: holds no policies of the {gait.name}; make an expert with 'glassgait train "
            f"{of}', students with 'glassgait distill {of}', or name the folder of a run with "
            "--source, for this gait alone"
        )
        if asked or robot is None:
            raise InputError(lacks)
        return Policies(gait, robot, str(folder), None, lacks, {})
    recorded = recorded_expert(folder)
    found = _find_recorded(gait, folder, robot)
    if found is None:
        kept = policy_path(folder, EXPERT)
        made_for = load_policy(kept, robot).gait if kept.exists() else gait.name
        if made_for != gait.name:
            raise InputError(
                f"{kept}: is an expert for gait {made_for!r}, not {gait.name!r}; name that gait "
                "with --gait, or another run with --source"
            )
        where, digest = recorded or (folder, "")
        raise InputError(
            f"{where}: the students' expert {digest} (key 'inputs.expert') is not found; put its "
            f"file there, as {policy_path(folder, EXPERT)}"
        )
    return Policies(gait, found[0].robot, str(folder), *found, files)


def _refuse_other_gait(gait: Gait, folder: Path) -> None:
    """Refuses policies of a gait of one's own that was edited since they were made.

    Of gaits that ship the policies themselves refuse it.
    """
    record = folder / CONFIG_NAME
    found = read_yaml(record) if record.exists() and gait.name not in gait_names() else None
    inputs = found.get("inputs") if isinstance(found, dict) else None
    made_for = inputs.get("gait") if isinstance(inputs, dict) else None
    if isinstance(made_for, str) and made_for != gait.digest():
        raise InputError(
            f"{record}: its policies were made for another {gait.name} than the gait is now (key "
            "'inputs.gait'); undo what was edited, or give the gait another name and train it"
        )


def _students_in(folder: Path, gait: str) -> dict[str, Path]:
    """Lists the files of students that a folder holds, by kind and in the order of tables."""
    found = [path for path in folder.glob("*") if path.suffix in POLICY_SUFFIXES]
    stems = sorted(
        path.stem
        for path in found
        if path.stem not in (gait, EXPERT) and path.name != CHECKPOINT_NAME
    )
    ranked = sorted(stems, key=rank)
    return {kind: policy_path(folder, kind) for kind in ranked}


def _find_recorded(
    gait: Gait, folder: Path, robot: Robot | None
) -> tuple[NeuralPolicy, str] | None:
    """Finds the expert whose digest a folder's record holds, and where it is from.

    A distillation keeps a copy of its expert. Of a folder without a record it is the gait's
    default expert.
    """
    recorded = recorded_expert(folder)
    name = robot.name if robot else DEFAULT_ROBOT
    trained = default_folder("train", name) / gait.name
    for path in (policy_path(folder, EXPERT), None, trained):
        if path is None:
            ships = gait.name in shipped_experts(name)
            expert = load_expert(gait, robot=robot) if ships else None
        else:
            expert = _expert_at(gait, path, robot)
        if expert is not None and (recorded is None or expert.digest() == recorded[1]):
            return expert, SHIPPED if path is None else str(path)
    return None


def _expert_at(gait: Gait, place: Path, robot: Robot | None) -> NeuralPolicy | None:
    """Loads the expert of a file or of a run's folder; None where there is none of this gait."""
    path = policy_path(place, gait.name) if place.is_dir() else place
    if path.suffix not in POLICY_SUFFIXES or not path.is_file():
        return None
    policy = load_policy(path, robot)
    fits = isinstance(policy, NeuralPolicy) and policy.gait == gait.name
    return load_expert(gait, path, robot) if fits else None
