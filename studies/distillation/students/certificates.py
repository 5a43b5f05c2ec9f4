"""Where certificates are kept, and finding that of a policy."""

from collections.abc import Iterator
from pathlib import Path

from glassgait.models.certificates.certificate import (
    Certificate,
    read_certificate,
    shipped_certificates,
)
from glassgait.models.errors import InputError
from glassgait.models.files import digest
from glassgait.models.robots.robot import DEFAULT_ROBOT, Robot, robot_folder
from glassgait.models.task.gait import Gait
from glassgait.studies.common.console import say

CERTIFICATION_FOLDER = Path("runs/certification")

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
        policy_file: File of the policy.
        gait: Its gait.
        path: File of the certificate; by default one in runs/certification/<gait> or, where that
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
    folder = robot_folder(CERTIFICATION_FOLDER, robot.name if robot else DEFAULT_ROBOT) / gait
    made_here = [(path, robot) for path in sorted(folder.glob(f"*/{CERTIFICATE_NAME}"))]
    for path, own in (*made_here, *((path, None) for path in shipped_certificates())):
        try:
            yield read_certificate(path, own)
        except InputError as error:
            say(f"left out: {error}")
