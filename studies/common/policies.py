"""Finding the policies of a gait: one rule for every command.

What ships is taken, unless `--source` names the folder of a run of train, distill or refine. Of a
gait that does not ship, the runs' default folders are taken: runs/distill/<gait>, or else
runs/train/<gait>; of another robot than the default one runs/train/<robot>/<gait> and so on.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from glassgait.models.errors import InputError, unknown_name
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.files import read_yaml
from glassgait.models.policies.controller import Controller, alone
from glassgait.models.policies.library import (
    POLICY_SUFFIXES,
    STUDENT_DIRECTORY,
    load_expert,
    load_policy,
    load_student_of,
    naming,
    policy_path,
    shipped_expert,
    shipped_experts,
)
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots.library import load_robot, robot_folder
from glassgait.models.robots.robot import DEFAULT_ROBOT, Robot
from glassgait.models.task.gait import Gait, gait_names
from glassgait.models.task.observation import ObservationLayout
from glassgait.studies.common.arguments import KINDS
from glassgait.studies.common.console import note
from glassgait.studies.common.run import CHECKPOINT_NAME, CONFIG_NAME, default_folder

EXPERT = "expert"
ALL = "all"
SHIPPED = "shipped"


@dataclass(frozen=True)
class Policies:
    """The policies of a gait that a command can use.

    Attributes:
        place: `shipped`, or the folder of a run.
        files: Files of the students by kind, in the order of tables.
        expert_there: The expert, and its file; None where there is none, so that only files of
            formulas that hold odometry can act.
    """

    gait: Gait
    robot: Robot
    place: str
    files: dict[str, Path]
    expert_there: NeuralPolicy | None = None
    expert_file: Path | None = None

    @property
    def expert(self) -> NeuralPolicy:
        """The expert, by whose estimator students observe; an InputError if there is none."""
        if self.expert_there is None:
            raise InputError(_lacking(self.gait, self.place, self.robot))
        return self.expert_there

    @property
    def origin(self) -> str:
        """A sentence about the policies' origin."""
        expert = "" if self.place == SHIPPED else f", the expert {self.expert_file or 'not found'}"
        return f"{self.gait.name}: policies from {self.place}{expert}"

    def output(self, study: str) -> Path:
        """Returns the default folder of a command's run of these policies."""
        return default_folder(study, self.robot.name) / self.gait.name

    @cached_property
    def students(self) -> dict[str, Policy]:
        """Every student, by kind."""
        return {kind: load_student_of(self.expert, path) for kind, path in self.files.items()}

    def file(self, name: str) -> Path:
        """Returns the file of `expert`, of a kind of student, or the file that a path names."""
        found = Path(name) if is_file(name) else {EXPERT: self.expert_file, **self.files}.get(name)
        if found is not None:
            return found
        # Without an expert, making one comes first.
        of = f"--gait {self.gait.name}{self.expert.robot.option}"
        remedy = f"; make it with 'glassgait distill {of} --students {name}'"
        raise unknown_name(
            f"{self.robot.name} {self.gait.name} policy",
            name,
            (EXPERT, *self.files),
            f" ({self.place}){remedy if name in KINDS else ''}; or name the file of a policy "
            f"ending in {' or '.join(POLICY_SUFFIXES)}, or another run with --source",
        )

    def policy(self, name: str) -> Policy:
        """Loads a policy by its name (see `file`), and refuses one for another machine."""
        path, expert = self.file(name), self.expert_of(name)
        if name == EXPERT:
            policy = self.expert
        elif expert is not None:
            policy = load_student_of(expert, path)
        else:
            policy = load_policy(path, self.robot)
            if not isinstance(policy.estimator, Odometry):
                lacking = _lacking(self.gait, self.place, self.robot)
                raise InputError(f"{path}: needs its expert's estimator. {lacking}")
            names = ObservationLayout(self.gait.n_states, imu=policy.layout.imu).names
            with naming(path):
                policy.check(gait=self.gait, observation_names=names)
        with naming(path):
            policy.refuse_other_machine(self.gait)
        return policy

    def formulas(self, name: str) -> FormulaPolicy:
        """Loads a policy that is made of formulas, and refuses others."""
        policy = self.policy(name)
        if not isinstance(policy, FormulaPolicy):
            raise InputError(
                f"--policy {name}: is of the kind {policy.kind!r}, not made of formulas; name a "
                f"student of formulas, or a {FormulaPolicy.suffix} file"
            )
        return policy

    def controller(self, name: str) -> Controller:
        """Loads a policy that acts without the expert, with the estimator that it observes by."""
        policy = self.policy(name)
        return alone(policy, None if isinstance(policy, NeuralPolicy) else self.expert_of(name))

    def expert_of(self, name: str) -> NeuralPolicy | None:
        """Returns the expert beside a policy's file, or else the gait's; None if there is none."""
        kept = policy_path(self.file(name).parent, EXPERT)
        if name == EXPERT or kept == self.expert_file or not kept.exists():
            return self.expert_there
        return load_expert(self.gait, kept, self.robot)

    def controllers(self, names: Iterable[str]) -> dict[str, Controller]:
        """Loads policies that act without the expert, by their names in folders and tables."""
        found: dict[str, Controller] = {}
        for name in self.named(names):
            stem = Path(name).stem if is_file(name) else name
            # The second of two files of one name is called by its path.
            found[name if stem in found else stem] = self.controller(name)
        return found

    def named(self, names: Iterable[str]) -> tuple[str, ...]:
        """Replaces `all` by the expert and every student there is."""
        given = tuple(names)
        return (EXPERT, *self.files) if ALL in given else given


def is_file(name: str) -> bool:
    """Returns whether a name is that of a policy's file, rather than a kind."""
    return Path(name).suffix in POLICY_SUFFIXES


def find_policies(
    gait: Gait, source: Path | None = None, robot: str | None = None, *, quiet: bool = False
) -> Policies:
    """Finds the policies of a gait, and prints their origin unless it is to be quiet.

    The robot is by default that of the run's policies, and of what ships the default one. A folder
    that holds no policies of the gait is refused, and one whose students' expert is not found.
    """
    name, known = gait.name, load_robot(robot or DEFAULT_ROBOT)
    if source is not None:
        found = _in_run(gait, source, known if robot else None)
        if found is None:
            raise InputError(_lacking(gait, str(source), known))
    elif name in shipped_experts(known.name):
        files = _students_in(robot_folder(STUDENT_DIRECTORY, known.name) / name, name)
        expert, path = load_expert(gait, robot=known), shipped_expert(name, known.name)
        found = Policies(gait, known, SHIPPED, files, expert, path)
    else:
        # Students keep their expert beside them, so a distillation is better than a training.
        distilled, trained = (
            default_folder(own, known.name) / name for own in ("distill", "train")
        )
        found = _in_run(gait, distilled, known) or _in_run(gait, trained, known)
        found = found or Policies(gait, known, str(trained), {})
    if not quiet:
        note(found.origin)
    return found


def find_expert(gait: Gait, source: Path | None = None, robot: str | None = None) -> NeuralPolicy:
    """Finds the expert that students of a gait are to imitate, as `find_policies` does.

    For a gait that does not ship, runs/train/<gait> is taken, even if students were distilled from
    an earlier expert.
    """
    known = load_robot(robot or DEFAULT_ROBOT)
    if source is None and gait.name not in shipped_experts(known.name):
        source = default_folder("train", known.name) / gait.name
    return find_policies(gait, source, robot).expert


def _in_run(gait: Gait, folder: Path, robot: Robot | None) -> Policies | None:
    """Finds the policies of a run; None where there are none."""
    files, trained = _students_in(folder, gait.name), policy_path(folder, gait.name)
    if not files and not trained.exists():
        return None
    _refuse_other_gait(gait, folder)

    # Take an expert that was trained here, or that students keep beside them, or what ships.
    kept, name = policy_path(folder, EXPERT), robot.name if robot else DEFAULT_ROBOT
    ships = shipped_expert(gait.name, name)
    path = next((path for path in (trained, kept, ships) if path.exists()), None)
    if path is None:
        raise InputError(
            f"{folder}: the students' expert is not found; put its file there as {kept}"
        )
    expert = load_expert(gait, path, robot)
    return Policies(gait, expert.robot, str(folder), files, expert, path)


def _lacking(gait: Gait, folder: str, robot: Robot) -> str:
    # A gait that does not ship is named by its file.
    of = f"--gait {gait.name}{'' if gait.name in gait_names() else '.yaml'}{robot.option}"
    return (
        f"{folder}: holds no policies of the {gait.name}; make an expert with 'glassgait train "
        f"{of}', students with 'glassgait distill {of}', or name the folder of a run with --source"
    )


def _refuse_other_gait(gait: Gait, folder: Path) -> None:
    # Policies refuse changes of built-in gaits themselves.
    record = folder / CONFIG_NAME
    found = read_yaml(record) if record.exists() and gait.name not in gait_names() else None
    match found:
        case {"inputs": {"gait": str(made_for)}} if made_for != gait.digest():
            raise InputError(
                f"{record}: its policies were made for another {gait.name} than the gait is now "
                "(key 'inputs.gait'); undo what was edited, or give the gait another name and "
                "train it"
            )


def _students_in(folder: Path, gait: str) -> dict[str, Path]:
    """Lists the files of students that a folder holds, by kind and in the order of tables."""
    files = (path for path in folder.glob("*") if path.name != CHECKPOINT_NAME)
    kinds = {path.stem for path in files if is_file(path.name)} - {gait, EXPERT}
    known = [kind for kind in KINDS if kind in kinds]
    return {kind: policy_path(folder, kind) for kind in (*known, *sorted(kinds.difference(known)))}
