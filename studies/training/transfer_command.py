"""`glassgait transfer`: writes policies of one robot anew for another, which learns nothing."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

from glassgait.models.errors import InputError
from glassgait.models.policies.library import find_gait
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import DEFAULT_ROBOT, Robot
from glassgait.models.settings import Settings
from glassgait.studies.common.console import console, say
from glassgait.studies.common.policies import EXPERT, Policies, find_policies_of
from glassgait.studies.common.run_folder import default_folder, open_run, refuse_run
from glassgait.studies.common.sweep import Gaits, folder_of, gaits_named


@dataclass(frozen=True)
class Transfer(Settings):
    """Write the expert and the formulas of one robot anew for another; nothing is learned.

    Attributes:
        robot: Name of the robot that is to act, or path of its robot.yaml.
        gait: Names of gaits, or paths of gait files; `all` for every gait that ships.
        of: Name of the robot whose policies are taken, or path of its robot.yaml.
        source: Folder of a run of train, simplify, distill or refine to take them from, in place
            of those that ship.
        output: Folder of the run; runs/transfer/<robot>/<gait> by default. Of several gaits each
            has its folder <gait> in it.
    """

    title: ClassVar[str] = "transfer"

    robot: str = DEFAULT_ROBOT
    gait: Gaits = ("trot",)
    of: str = DEFAULT_ROBOT
    source: Path | None = None
    output: Path | None = None

    def run(self) -> None:
        """Writes the policies of each gait."""
        robot = load_robot(self.robot)
        gaits = [find_gait(name, self.of) for name in gaits_named(self.gait)]
        found = find_policies_of(gaits, self.source, robot=self.of)
        if load_robot(self.of).name == robot.name:
            raise InputError(
                f"--robot {self.robot}: is the robot whose policies are taken; name the one that "
                "is to act"
            )
        root, alone = default_folder(self.title, robot.name), len(found) == 1
        folders = {
            name: folder_of([name], root=root, output=self.output, alone=alone) for name in found
        }
        # Refused before any is written.
        for folder in folders.values():
            refuse_run(folder)
        written = {name: _written_for(robot, policies) for name, policies in found.items()}
        for name, (named, inputs) in written.items():
            self._write(name, named, inputs, folders[name])

    def _write(
        self, gait: str, named: Mapping[str, Policy], inputs: Mapping[str, str], folder: Path
    ) -> None:
        with open_run(
            folder,
            study=self.title,
            settings=replace(self, gait=(gait,)),
            inputs=inputs,
            resume=False,
        ):
            for name, policy in named.items():
                policy.save(folder / f"{name}{policy.suffix}")
        console.print(
            f"{', '.join(EXPERT if name == gait else name for name in named)} of "
            f"{load_robot(self.robot).full_name} written to {folder}; see whether it walks by "
            f"'glassgait evaluate worlds --robot {self.robot} --gait {gait} --source {folder}'",
            soft_wrap=True,
        )


def _written_for(robot: Robot, policies: Policies) -> tuple[dict[str, Policy], dict[str, str]]:
    """Returns policies of a gait as a robot's, by their files' names, and digests of their inputs.

    Raises:
        InputError: if none can be written for the robot, or there are none.
    """
    students = {
        kind: student.for_robot(robot)
        for kind, student in policies.students.items()
        if isinstance(student, FormulaPolicy) and student.observes_by is None
    }
    gait, inputs = policies.gait.name, policies.inputs()
    named: dict[str, Policy] = {**students}
    try:
        named = {gait: policies.expert.for_robot(robot), **named}
        inputs["expert"] = named[gait].digest()
    except InputError as error:
        if not students:
            raise
        say(f"the expert is left out: {error}")
    return named, inputs
