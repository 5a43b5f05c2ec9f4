"""`glassgait verify`: proves what a policy can never do, and checks such proofs."""

import time
from collections.abc import Sequence
from dataclasses import field
from pathlib import Path
from typing import Annotated, ClassVar

import pandas as pd
import tyro

from glassgait.diagrams.scenario import load_scenarios
from glassgait.models.certificates.box import ObservationBox, load_box, operating_box
from glassgait.models.certificates.certificate import (
    OUTCOME_WORDS,
    certificate,
    certificate_text,
    shipped_certificates,
)
from glassgait.models.certificates.claims import Claim, claim_files, load_claims
from glassgait.models.certificates.prover import Prover, Verdict
from glassgait.models.errors import InputError
from glassgait.models.files import digest, write_atomically
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.settings import FEW, Settings, checked
from glassgait.models.task.gait import Gait
from glassgait.studies.common.console import console, progress_bar
from glassgait.studies.common.policies import Policies
from glassgait.studies.common.rollouts import RolloutConfig
from glassgait.studies.common.run_folder import digest_of_files, open_run
from glassgait.studies.common.sweep import WorkersConfig
from glassgait.studies.common.tables import print_table, write_metrics, write_table
from glassgait.studies.distillation.students import OnePolicy
from glassgait.studies.verification.measurement import measure_box

BOX_NAME = "box.yaml"
CERTIFICATE_NAME = "certificate.json"


@checked
class Prove(OnePolicy):
    """Prove what a policy of formulas can never do, or find the observation where it does.

    Attributes:
        policy: A kind of student made of formulas, or path of a policy file; by default the
            student whose actions are sums of the fewest terms.
        claims: YAML file of claims of your own, besides those that ship.
        box: File of the operating box; the gait's shipped one by default.
        measure: Measure the operating box anew, in all scenarios, before anything is proved.
        rollouts: How robots are rolled out to measure it.
        workers: Where they are.
        resume: Continue the run that the folder holds.
        output: Folder of the results; runs/verify/prove/<gait>/<policy> by default.
    """

    title: ClassVar[str] = "verify prove"

    claims: Path | None = None
    box: Path | None = None
    measure: bool = False
    rollouts: Annotated[RolloutConfig, tyro.conf.arg(name="")] = field(
        default_factory=lambda: RolloutConfig(n_robots=4, n_steps=100, n_seeds=1)
    )
    workers: Annotated[WorkersConfig, tyro.conf.arg(name="")] = field(default_factory=WorkersConfig)
    resume: bool = False
    output: Path | None = None

    def run(self) -> None:
        """Measures where it is asked for, proves, and writes the certificate."""
        if self.box and self.measure:
            raise InputError("--box: is not read where the box is measured; leave out one of both")
        found, name = self.find()
        gait = found.gait
        path, policy = found.file(name), found.policy(name)
        if isinstance(policy, FormulaPolicy) and policy.machine is None:
            raise InputError(
                f"{path}: holds no machine, so that no certificate of it could be checked; write "
                "the gait's under 'machine' in its header"
            )
        claims = self._claims(gait, policy)
        folder = self.output or found.output(self.title) / Path(name).stem
        inputs = {
            "gait": gait.digest(),
            "policy": digest(path),
            "claims": digest_of_files(
                [*claim_files(imu=policy.layout.imu), *([self.claims] if self.claims else [])]
            ),
        }
        run = {"study": self.title, "settings": self, "resume": self.resume}
        with open_run(folder, **run, inputs=inputs):
            box = self._box(found, folder)
            started = time.perf_counter()
            prover = Prover(policy, gait, box)
            verdicts = _proved(prover, claims)
            seconds = time.perf_counter() - started
            _write(prover, verdicts, path, folder, seconds)
        console.print(f"written to {folder}")

    def _claims(self, gait: Gait, policy: Policy) -> tuple[Claim, ...]:
        imu, about = policy.layout.imu, (policy.robot, policy.joint_law)
        shipped = [claim for path in claim_files(imu=imu) for claim in load_claims(path, *about)]
        own = load_claims(self.claims, *about) if self.claims else ()
        taken = {claim.name for claim in shipped}
        for claim in own:
            if claim.name in taken:
                raise InputError(
                    f"{self.claims}: {claim.refused_as()}: a claim that ships is called so; rename "
                    "it"
                )
            try:
                claim.refuse_unknown(gait, imu=imu)
            except InputError as error:
                raise InputError(f"{self.claims}: {error}") from error
        return *shipped, *own

    def _box(self, policies: Policies, folder: Path) -> ObservationBox:
        gait, measured = policies.gait, folder / BOX_NAME
        if self.box:
            return load_box(self.box, gait, policies.robot)
        if not self.measure:
            return operating_box(gait, policies.robot)
        if not (self.resume and measured.exists()):
            box, how = measure_box(
                gait,
                policies.expert,
                policies.students,
                load_scenarios(("all",)),
                self.rollouts,
                processes=self.workers.processes,
            )
            box.save(measured, gait, how)
        return load_box(measured, gait, policies.robot)


def _proved(prover: Prover, claims: Sequence[Claim]) -> list[Verdict]:
    """Decides every claim that says something of the policy."""
    verdicts = []
    with progress_bar(len(claims)) as (progress, bar):
        for claim in claims:
            progress.update(bar, text=claim.name)
            verdict = prover.decide(claim)
            verdicts += [verdict] if verdict else []
            progress.update(bar, advance=1)
    return verdicts


def _claims_table(verdicts: Sequence[Verdict]) -> pd.DataFrame:
    """Returns a row a claim: whether it holds, and what comes closest to breaking it."""
    return pd.DataFrame(
        {
            "claim": [own.claim.name for own in verdicts],
            "outcome": [OUTCOME_WORDS[own.outcome] for own in verdicts],
            "worst": [own.worst for own in verdicts],
            "claimed": [own.claimed for own in verdicts],
            "where": [own.where for own in verdicts],
        }
    )


def _write(
    prover: Prover, verdicts: Sequence[Verdict], path: Path, folder: Path, seconds: float
) -> None:
    claims = _claims_table(verdicts)
    write_table(claims, folder / "claims")
    counts = {word: int((claims["outcome"] == word).sum()) for word in OUTCOME_WORDS.values()}
    write_metrics({**counts, "seconds": seconds}, folder / "metrics.json")
    written = certificate(prover, verdicts, path)
    write_atomically(folder / CERTIFICATE_NAME, certificate_text(written))
    print_table(f"{prover.gait.name}: what {path.name} can never do", claims)
    found = ", ".join(f"{count} {outcome}" for outcome, count in counts.items())
    console.print(found)


@checked
class Check(Settings):
    """Check a certificate by arithmetic of its own, without the program that proved it.

    Attributes:
        certificates: Files of certificates, or folders that hold one; those that ship by default.
        policy: The policy's file, of a certificate of one that does not ship.
        robot: The robot's file, of a certificate of one that does not ship.
    """

    title: ClassVar[str] = "verify check"

    certificates: Annotated[tuple[Path, ...], FEW, tyro.conf.Positional] = ()
    policy: Path | None = None
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
        given = {"--policy": self.policy, "--robot": self.robot}
        for option, file in given.items():
            if file and len(self.certificates) != 1:
                raise InputError(f"{option}: is of one certificate; name one")
        named = self.certificates or shipped_certificates()
        paths = [path / CERTIFICATE_NAME if path.is_dir() else path for path in named]
        if missing := [path for path in paths if not path.exists()]:
            raise InputError(f"{missing[0]}: no such file; 'glassgait verify prove' writes one")
        with progress_bar(len(paths)) as (progress, bar):
            for path in paths:
                progress.update(bar, text=f"checking {path.name}")
                try:
                    found = check(path, self.policy, self.robot)
                except RefusedError as error:
                    raise InputError(f"{path}: {error}") from error
                console.print(f"{path}: {found}")
                progress.update(bar, advance=1)
