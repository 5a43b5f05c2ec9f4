"""`glassgait verify check`: checks certificates."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from glassgait.models.certificates.certificate import shipped_certificates
from glassgait.models.errors import InputError
from glassgait.models.settings import FEW, Settings
from glassgait.studies.common.console import console
from glassgait.studies.distillation.students.library import CERTIFICATE_NAME


@dataclass(frozen=True)
class Check(Settings):
    """Check a certificate by arithmetic of its own, without the program that proved it.

    Attributes:
        certificates: Files of certificates, or folders that hold one; those that ship by default.
        policy: The policy's file, of a certificate of one that does not ship.
        gait: The gait's file, of a certificate of one that does not ship.
        robot: The robot's file, of a certificate of one that does not ship.
    """

    title: ClassVar[str] = "check"

    certificates: Annotated[tuple[Path, ...], FEW, tyro.conf.Positional] = ()
    policy: Path | None = None
    gait: Path | None = None
    robot: Path | None = None

    def run(self) -> None:
        """Checks each, and reports what holds."""
        try:
            # Imported here: no other command needs what the checker computes with.
            from glassgait.models.certificates.checker import (  # noqa: PLC0415
                RefusedError,
                check,
            )
        except ImportError as error:
            raise InputError(str(error)) from error
        given = {"--policy": self.policy, "--gait": self.gait, "--robot": self.robot}
        for option, file in given.items():
            if file and len(self.certificates) != 1:
                raise InputError(f"{option}: is of one certificate; name one")
        for named in self.certificates or shipped_certificates():
            path = named / CERTIFICATE_NAME if named.is_dir() else named
            if not path.exists():
                raise InputError(f"{path}: no such file; 'glassgait verify prove' writes one")
            try:
                found = check(path, self.policy, self.gait, self.robot)
                console.print(f"{path}: {found}")
            except RefusedError as error:
                raise InputError(f"{path}: {error}") from error
