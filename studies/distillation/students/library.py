"""Where students and their certificates are kept, and finding them."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from glassgait.models.certificates.certificate import (
    Certificate,
    read_certificate,
    shipped_certificates,
)
from glassgait.models.errors import InputError
from glassgait.models.files import digest
from glassgait.models.policies.library import (
    load_student_of,
    policy_path,
)
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.robots.robot import DEFAULT_ROBOT, Robot
from glassgait.models.task.gait import Gait
from glassgait.studies.common.console import say
from glassgait.studies.common.policies import OneGait, Policies
from glassgait.studies.common.run_folder import CONFIG_NAME, default_folder, read_settings
from glassgait.studies.distillation.students.registry import STUDENTS, sums_of_terms
from glassgait.studies.distillation.students.student import ITSELF


def samples_folder(folder: Path, kind: str) -> Path:
    """Returns where a run keeps the samples that a student of a kind is fitted to.

    Raises:
        InputError: if the folder holds a run of something else, or its settings are damaged.
    """
    collector = STUDENTS[kind].collector or kind
    if (folder / CONFIG_NAME).exists():
        collector = read_settings(folder, "distill").get("collector") or collector
    return folder / (kind if collector == ITSELF else str(collector))


def load_students(folder: Path, expert: NeuralPolicy) -> dict[str, Policy]:
    """Loads the students of a run, by kind.

    Raises:
        InputError: if the folder holds none, or a student does not fit the expert.
    """
    kinds = [kind for kind in STUDENTS if policy_path(folder, kind).exists()]
    if not kinds:
        raise InputError(
            f"{folder}: holds no students; make them with "
            f"'glassgait distill --gait {expert.gait}{expert.robot.option}'"
        )
    return {kind: load_student_of(expert, policy_path(folder, kind)) for kind in kinds}


@dataclass(frozen=True)
class OnePolicy(OneGait):
    """Settings of a command that takes one student.

    Attributes:
        policy: Kind of student, or path of a policy file; by default the student whose actions are
            sums of the fewest terms.
    """

    policy: str | None = None

    def find(self) -> tuple[Policies, str]:
        """Finds the policies of the gait, and returns the name of the one that is taken."""
        found = self.policies()
        return found, self.policy or default_student(found)


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
        f"'glassgait distill --gait {gait}{found.robot.option} --students {sums_of_terms()[1]}', "
        "or name another run with --source"
    )


CERTIFICATE_NAME = "certificate.json"


def certificates_of(gait: Gait, robot: Robot | None = None) -> list[Certificate]:
    """Lists the certificates of a gait's policies: those that were made here, and those that ship.

    Of a policy that has several there is the first one; a damaged file is reported and
    left out.
    """
    found: dict[str, Certificate] = {}
    for certificate in _certificates(gait.name, robot):
        if certificate.is_of(gait, certificate.policy_digest):
            found.setdefault(certificate.policy_digest, certificate)
    return list(found.values())


def find_certificate(
    policy_file: Path, gait: Gait, path: Path | None = None, robot: Robot | None = None
) -> Certificate | None:
    """Finds the certificate of a policy, by the digest of the policy's file.

    Args:
        path: File of the certificate; by default one in runs/verify/prove/<gait> or, where that
            holds none of this policy, one that ships.
        robot: The policy's robot; the default one by default.

    Returns:
        The certificate; None where no file is named and there is none of this policy.

    Raises:
        InputError: if a file is named that is no certificate, or that of another policy.
    """
    policy = digest(policy_file)
    if path is None:
        own = (one for one in certificates_of(gait, robot) if one.policy_digest == policy)
        return next(own, None)
    certificate = read_certificate(path, robot)
    if not certificate.is_of(gait, policy):
        raise InputError(
            f"{path}: is of another policy than {policy_file}, or of another gait; make one with "
            f"'glassgait verify prove --gait {gait.name} --policy {policy_file}'"
        )
    return certificate


def _certificates(gait: str, robot: Robot | None) -> Iterator[Certificate]:
    folder = default_folder("verify prove", robot.name if robot else DEFAULT_ROBOT) / gait
    made_here = [(path, robot) for path in sorted(folder.glob(f"*/{CERTIFICATE_NAME}"))]
    ship = (path for path in shipped_certificates() if path.name.startswith(f"{gait}_"))
    for path, own in (*made_here, *((path, None) for path in ship)):
        try:
            certificate = read_certificate(path, own)
        except InputError as error:
            say(f"left out: {error}")
            continue
        if certificate.robot == (robot.name if robot else DEFAULT_ROBOT):
            yield certificate
