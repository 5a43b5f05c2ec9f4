"""`glassgait verify`: proves claims about a policy of formulas, and checks such proofs."""

import time
from collections.abc import Mapping
from dataclasses import field
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
import pandas as pd
import tyro
from joblib import delayed

from glassgait.diagrams.scenario import Scenario, load_scenarios
from glassgait.models.arrays import Array
from glassgait.models.certificates.box import (
    MARGIN,
    ObservationBox,
    load_box,
    measured_box,
    operating_box,
)
from glassgait.models.certificates.certificate import (
    OUTCOME_WORDS,
    certificate,
    certificate_text,
    check_certificate,
    shipped_certificates,
)
from glassgait.models.certificates.claims import Claim, claim_files, load_claims
from glassgait.models.certificates.prover import Prover
from glassgait.models.errors import InputError
from glassgait.models.files import digest, write_atomically
from glassgait.models.policies.controller import Controller, alone
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.settings import FEW, Settings, checked
from glassgait.models.task.gait import Gait
from glassgait.studies.common.console import console, progress_bar
from glassgait.studies.common.episode import episode
from glassgait.studies.common.jobs import Workers, run_parallel
from glassgait.studies.common.observers import Observations
from glassgait.studies.common.policies import Policies
from glassgait.studies.common.rollouts import RolloutConfig
from glassgait.studies.common.run import open_run
from glassgait.studies.common.tables import print_table, write_metrics, write_table
from glassgait.studies.distillation.students import OnePolicy

CERTIFICATE_NAME = "certificate.json"
COLUMNS = pd.Index(["claim", "outcome", "worst", "claimed", "where"])


@checked
class Prove(OnePolicy):
    """Prove claims about a policy of formulas, or find observations that refute them.

    Attributes:
        policy: A kind of student made of formulas, or path of a policy file; by default the
            student whose actions are sums of the fewest terms.
        claims: YAML file of further claims, besides those that ship.
        box: File of the operating box; the gait's shipped one by default.
        measure: First measure the operating box, in all scenarios.
        rollouts: Rollouts that measure the box.
        workers: Workers that run these rollouts.
        output: Folder of the results; runs/verify/prove/<gait>/<policy> by default.
    """

    title: ClassVar[str] = "verify prove"

    claims: Path | None = None
    box: Path | None = None
    measure: bool = False
    rollouts: Annotated[RolloutConfig, tyro.conf.arg(name="")] = field(
        default_factory=lambda: RolloutConfig(n_robots=4, n_steps=100, n_seeds=1)
    )
    workers: Annotated[Workers, tyro.conf.arg(name="")] = field(default_factory=Workers)
    output: Path | None = None

    def run(self) -> None:
        """Measures the box if requested, decides the claims, and writes the certificate."""
        # Refuse settings and policies whose claims cannot be proved or checked.
        if self.box and self.measure:
            raise InputError("--box: cannot be used with --measure; leave out one of both")
        policies, name = self.find()
        gait, path, policy = policies.gait, policies.file(name), policies.policy(name)
        if isinstance(policy, FormulaPolicy) and policy.machine is None:
            raise InputError(
                f"{path}: has no reward machine; write the gait's under 'machine' in its header"
            )
        claims = self._claims(gait, policy)

        folder = self.output or policies.output(self.title) / Path(name).stem
        inputs = {"gait": gait.digest(), "policy": digest(path)}
        with open_run(folder, study=self.title, settings=self, inputs=inputs, resume=False):
            # Decide each claim.
            prover, started = Prover(policy, gait, self._box(policies, folder)), time.time()
            verdicts = []
            with progress_bar(len(claims)) as (progress, bar):
                for claim in claims:
                    progress.update(bar, text=claim.name)
                    verdicts += filter(None, [prover.decide(claim)])
                    progress.update(bar, advance=1)

            # Write the table and the certificate.
            rows = [
                (each.claim.name, OUTCOME_WORDS[each.outcome], each.worst, each.claimed, each.where)
                for each in verdicts
            ]
            table = pd.DataFrame(rows, columns=COLUMNS)
            write_table(table, folder / "claims")
            outcomes = table["outcome"].tolist()
            counts = {word: outcomes.count(word) for word in OUTCOME_WORDS.values()}
            write_metrics({**counts, "seconds": time.time() - started}, folder / "metrics.json")
            text = certificate_text(certificate(prover, verdicts, path))
            write_atomically(folder / CERTIFICATE_NAME, text)
        print_table(f"{gait.name}: claims about {path.name}", table)
        console.print(", ".join(f"{count} {word}" for word, count in counts.items()))
        console.print(f"written to {folder}")

    def _claims(self, gait: Gait, policy: Policy) -> tuple[Claim, ...]:
        imu = policy.layout.imu
        shipped = [claim for path in claim_files(imu=imu) for claim in load_claims(path)]
        further = load_claims(self.claims) if self.claims else ()
        for claim in further:
            if claim.name in {each.name for each in shipped}:
                name = f"{self.claims}: {claim.refused_as()}"
                raise InputError(f"{name}: a claim that ships has this name; rename yours")
            try:
                claim.refuse_unknown(gait, imu=imu)
            except InputError as error:
                raise InputError(f"{self.claims}: {error}") from error
        return *shipped, *further

    def _box(self, policies: Policies, folder: Path) -> ObservationBox:
        gait, robot = policies.gait, policies.robot
        if self.measure:
            expert = policies.expert
            controllers = {"expert": alone(expert)}
            controllers |= {kind: alone(each, expert) for kind, each in policies.students.items()}
            with self.workers.pool():
                box, how = measure_box(gait, controllers, load_scenarios(("all",)), self.rollouts)
            box.save(folder / "box.yaml", gait, how)
            return load_box(folder / "box.yaml", gait, robot)
        return load_box(self.box, gait, robot) if self.box else operating_box(gait, robot)


def measure_box(
    gait: Gait,
    controllers: Mapping[str, Controller],
    scenarios: Mapping[str, Scenario],
    config: RolloutConfig,
) -> tuple[ObservationBox, str]:
    """Returns the box of observations of robots that do not fall, and describes the measurement."""
    jobs = [
        delayed(_observed_range)(gait, controller, scenario, config)
        for scenario in scenarios.values()
        for controller in controllers.values()
    ]
    corners = []
    with progress_bar(len(jobs)) as (progress, bar):
        for corner in run_parallel(jobs):
            corners += [] if corner is None else [corner]
            progress.update(bar, advance=1)

    # Widen the ranges of all robots.
    if not corners:
        raise InputError(f"every robot of the {gait.name} fell; raise --n-robots")
    lower, upper = (np.array(ends) for ends in zip(*corners, strict=True))
    policy = next(iter(controllers.values())).policy
    ends = lower.min(axis=0), upper.max(axis=0)
    box = measured_box(gait, policy.robot, policy.observation_names, *ends)
    how = (
        f"{gait.name}: what {config.n_robots} robots a scenario sensed in {config.n_steps} control "
        f"steps without a fall, in each of {len(scenarios)} scenarios, led by each of "
        f"{', '.join(controllers)} (seed {config.seed}); each range widened by {MARGIN:.0%} of its "
        "width on both sides; commands, counts and machine state at their true ranges"
    )
    return box, how


def _observed_range(
    gait: Gait, controller: Controller, scenario: Scenario, config: RolloutConfig
) -> tuple[Array, Array] | None:
    """Returns the least and greatest observations (n,) of the robots that stay up."""
    scenario, observations = config.commanding(scenario), Observations()
    ended = episode(
        gait,
        controller,
        scenario,
        n_robots=config.robots_in(scenario),
        n_steps=config.n_steps,
        seed=config.seed,
        observers=[observations],
    )
    up = ended.fell == config.n_steps
    if not up.any():
        return None
    observed = observations.array[:, up]
    return observed.min(axis=(0, 1)), observed.max(axis=(0, 1))


@checked
class Check(Settings):
    """Check a certificate with separate arithmetic, without the program that proved it.

    Attributes:
        certificates: Files of certificates, or folders with one; those that ship by default.
        policy: The policy's file, if the policy does not ship.
        robot: The robot's file, if the robot does not ship.
    """

    title: ClassVar[str] = "verify check"

    certificates: Annotated[tuple[Path, ...], FEW, tyro.conf.Positional] = ()
    policy: Path | None = None
    robot: Path | None = None

    def run(self) -> None:
        for option, file in {"--policy": self.policy, "--robot": self.robot}.items():
            if file and len(self.certificates) != 1:
                raise InputError(f"{option}: is of one certificate; name one")

        named = self.certificates or shipped_certificates()
        paths = [path / CERTIFICATE_NAME if path.is_dir() else path for path in named]
        with progress_bar(len(paths)) as (progress, bar):
            for path in paths:
                progress.update(bar, text=f"checking {path.name}")
                console.print(f"{path}: {check_certificate(path, self.policy, self.robot)}")
                progress.update(bar, advance=1)
