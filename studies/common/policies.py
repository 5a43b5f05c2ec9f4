"""Finds the policies of a gait, for all commands.

`--source` names the folder of a run of train, distill or refine. Without it, policies of built-in
gaits are the shipped ones, and those of other gaits come from runs/distill/<gait>, otherwise from
runs/train/<gait> (runs/train/<robot>/<gait> for a robot other than the default).
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from glassgait.models.errors import InputError, unknown_name
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.files import read_yaml
from glassgait.models.policies.controller import Controller, alone
from glassgait.models.policies.described import load_described
from glassgait.models.policies.library import (
    EXPERTS,
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
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots.library import load_robot, robot_folder
from glassgait.models.robots.robot import DEFAULT_ROBOT, Robot
from glassgait.models.task.gait import Gait, gait_names, gait_option
from glassgait.models.task.observation import ObservationLayout
from glassgait.studies.common.arguments import KINDS
from glassgait.studies.common.console import note
from glassgait.studies.common.run import CHECKPOINT_NAME, CONFIG_NAME, default_folder

EXPERT = "expert"
ALL = "all"
SHIPPED = "shipped"
DESCRIPTION_SUFFIXES = (".yaml", ".yml")  # of descriptions of networks; see `load_described`


@dataclass(frozen=True)
class Policies:
    """The available policies of a gait.

    Attributes:
        place: `shipped`, or the folder of a run.
        files: Files of the students by kind, in the order of tables.
        optional_expert: The expert, or None. Without an expert, only formula files that contain
            odometry can act.
    """

    gait: Gait
    robot: Robot
    place: str
    files: dict[str, Path]
    optional_expert: Policy | None = None
    expert_file: Path | None = None

    @property
    def expert(self) -> Policy:
        """The expert, whose estimator students use; raises an InputError if there is none."""
        if self.optional_expert is None:
            raise InputError(_no_policies(self.gait, self.place, self.robot))
        return self.optional_expert

    @property
    def origin(self) -> str:
        """A sentence on the policies' origin."""
        expert = "" if self.place == SHIPPED else f", the expert {self.expert_file or 'not found'}"
        return f"{self.gait.name}: policies from {self.place}{expert}"

    def output(self, study: str) -> Path:
        """Returns a command's default output folder for these policies."""
        return default_folder(study, self.robot.name) / self.gait.name

    @cached_property
    def students(self) -> dict[str, Policy]:
        """All students, by kind."""
        return {kind: load_student_of(self.expert, path) for kind, path in self.files.items()}

    def file(self, name: str) -> Path:
        """Returns the file of `expert` or of a kind of student; a path is returned as it is."""
        path = Path(name) if is_file(name) else {EXPERT: self.expert_file, **self.files}.get(name)
        if path is not None:
            return path
        # `self.expert` raises an InputError if the expert is missing too.
        options = f"{gait_option(self.gait.name)}{self.expert.robot.option}"
        remedy = f"; make it with 'glassgait distill {options} --students {name}'"
        raise unknown_name(
            f"{self.robot.name} {self.gait.name} policy",
            name,
            (EXPERT, *self.files),
            f" ({self.place}){remedy if name in KINDS else ''}; or give a policy's file "
            f"ending in {', '.join(POLICY_SUFFIXES)} or .yaml, or another run with --source",
        )

    def policy(self, name: str) -> Policy:
        """Loads a policy by its name (see `file`); raises an InputError if the gait differs."""
        if Path(name).suffix in DESCRIPTION_SUFFIXES:
            return load_described(name, self.gait)
        path, expert = self.file(name), self.expert_of(name)
        if name == EXPERT:
            policy = self.expert
        elif expert is not None:
            policy = load_student_of(expert, path)
        else:
            policy = load_policy(path, self.robot)
            if not isinstance(policy.estimator, Odometry):
                problem = _no_policies(self.gait, self.place, self.robot)
                raise InputError(f"{path}: needs its expert's estimator. {problem}")
            names = ObservationLayout(self.gait.n_states, imu=policy.layout.imu).names
            with naming(path):
                policy.check(gait=self.gait, observation_names=names)
        with naming(path):
            policy.refuse_other_machine(self.gait)
        return policy

    def formulas(self, name: str) -> FormulaPolicy:
        """Loads a formula policy; raises an InputError for other policies."""
        policy = self.policy(name)
        if not isinstance(policy, FormulaPolicy):
            raise InputError(
                f"--policy {name}: is of kind {policy.kind!r}, not made of formulas; name another"
            )
        return policy

    def controller(self, name: str) -> Controller:
        """Loads a controller of one policy that acts without the expert, with its estimator."""
        policy = self.policy(name)
        return alone(policy, None if policy.kind in EXPERTS else self.expert_of(name))

    def expert_of(self, name: str) -> Policy | None:
        """Returns the expert beside a policy's file, otherwise the gait's; None without one."""
        path = policy_path(self.file(name).parent, EXPERT)
        if name == EXPERT or path == self.expert_file or not path.exists():
            return self.optional_expert
        return load_expert(self.gait, path, self.robot)

    def controllers(self, names: Iterable[str]) -> dict[str, Controller]:
        """Loads a controller of each policy that acts without the expert, by name in tables."""
        controllers: dict[str, Controller] = {}
        for name in self.expanded(names):
            stem = Path(name).stem if is_file(name) else name
            # If two files have the same stem, the second is named by its path.
            controllers[name if stem in controllers else stem] = self.controller(name)
        return controllers

    def expanded(self, names: Iterable[str]) -> tuple[str, ...]:
        """Returns the names, with `all` replaced by the expert and every student."""
        names = tuple(names)
        return (EXPERT, *self.files) if ALL in names else names


def is_file(name: str) -> bool:
    """Returns whether a name is the path of a policy or a description, rather than a kind."""
    return Path(name).suffix in (*POLICY_SUFFIXES, *DESCRIPTION_SUFFIXES)


def find_policies(
    gait: Gait, source: Path | None = None, robot: str | None = None, *, quiet: bool = False
) -> Policies:
    """Finds the policies of a gait, and prints their origin unless `quiet`.

    The robot is by default the robot of the run's policies, or the default robot.
    """
    name, body = gait.name, load_robot(robot or DEFAULT_ROBOT)
    if source is not None:
        policies = _in_run(gait, source, body if robot else None)
        if policies is None:
            raise InputError(_no_policies(gait, str(source), body))
    elif name in shipped_experts(body.name):
        files = _students_in(robot_folder(STUDENT_DIRECTORY, body.name) / name, name)
        expert, path = load_expert(gait, robot=body), shipped_expert(name, body.name)
        policies = Policies(gait, body, SHIPPED, files, expert, path)
    else:
        # A distillation comes first, since its folder contains the students' expert too.
        distilled, trained = (
            default_folder(study, body.name) / name for study in ("distill", "train")
        )
        policies = _in_run(gait, distilled, body) or _in_run(gait, trained, body)
        policies = policies or Policies(gait, body, str(trained), {})
    if not quiet:
        note(policies.origin)
    return policies


def find_expert(gait: Gait, source: Path | None = None, robot: str | None = None) -> Policy:
    """Finds the expert for distillation, like `find_policies`.

    The expert of a gait that is not built in comes from runs/train/<gait>, even if students were
    distilled from an earlier expert. The source may also be the description of a network.
    """
    if source is not None and source.suffix in DESCRIPTION_SUFFIXES:
        return load_described(source, gait)
    body = load_robot(robot or DEFAULT_ROBOT)
    if source is None and gait.name not in shipped_experts(body.name):
        source = default_folder("train", body.name) / gait.name
    return find_policies(gait, source, robot).expert


def _in_run(gait: Gait, folder: Path, robot: Robot | None) -> Policies | None:
    """Finds the policies of a run; returns None without any."""
    files, trained = _students_in(folder, gait.name), policy_path(folder, gait.name)
    if not files and not trained.exists():
        return None
    _refuse_other_gait(gait, folder)

    # The expert was trained in this run, is beside the students, or is the shipped one.
    beside, name = policy_path(folder, EXPERT), robot.name if robot else DEFAULT_ROBOT
    shipped = shipped_expert(gait.name, name)
    path = next((path for path in (trained, beside, shipped) if path.exists()), None)
    if path is None:
        raise InputError(f"{folder}: the students' expert is not found; copy its file to {beside}")
    expert = load_expert(gait, path, robot)
    return Policies(gait, expert.robot, str(folder), files, expert, path)


def _no_policies(gait: Gait, folder: str, robot: Robot) -> str:
    # A gait that is not built in is given by its file.
    of = f"{gait_option(gait.name)}{robot.option}"
    return (
        f"{folder}: contains no policies of the {gait.name}; make an expert with 'glassgait train "
        f"{of}', students with 'glassgait distill {of}', or give the folder of a run with --source"
    )


def _refuse_other_gait(gait: Gait, folder: Path) -> None:
    # Policies detect changes of built-in gaits themselves.
    path = folder / CONFIG_NAME
    record = read_yaml(path) if path.exists() and gait.name not in gait_names() else None
    match record:
        case {"inputs": {"gait": str(made_for)}} if made_for != gait.digest():
            raise InputError(
                f"{path}: its policies were made for another {gait.name} than the gait is now "
                "(key 'inputs.gait'); undo the edits of the gait, or rename it and train it"
            )


def _students_in(folder: Path, gait: str) -> dict[str, Path]:
    """Returns a folder's student files by kind, in the order of tables."""
    files = (path for path in folder.glob("*") if path.name != CHECKPOINT_NAME)
    kinds = {path.stem for path in files if path.suffix in POLICY_SUFFIXES} - {gait, EXPERT}
    known = [kind for kind in KINDS if kind in kinds]
    return {kind: policy_path(folder, kind) for kind in (*known, *sorted(kinds.difference(known)))}
